import { colour, digits, fixed, make, svg } from "./dom";
import type { Live } from "./live";
import { drawGroup, groupAlarms, groupAt, type Group } from "./groups";
import { SvgPen, type Pen, type Point, type Style } from "./pen";
import { BORDER, drawAlarm, drawObject, drawTarget, HALO, INK, LABELS, SHADOW, SHORT } from "./symbols";
import type { Choice, Detection, Source } from "./types";
import { detectionOf } from "./data";
import type { View } from "./view";

export interface Shown {
  alarms: boolean;
  truth: boolean;
  scans: boolean;
}
export interface Overlay {
  source: Source;
  detection: Detection | undefined;
  threshold: number | null | undefined;
  visible: (row: number) => boolean;
  inSubset: (target: number) => boolean;
  selected: number | null;
  second: { source: Source; detection: Detection; visible: (row: number) => boolean } | null;
  live: Live | null;
  scan: number | null;
  /** Whether ground that no scan has seen has come into sight. */
  gaps: boolean;
  /** Alarms by cells of the picture, where there is no room to draw each. */
  groups: Group[] | null;
  show: Shown;
}
export interface Hit { kind: "alarm" | "group" | "target" | "object" | "scan"; row: number; words: string }

export function labelOf(source: Source, detection: Detection | undefined, row: number): string {
  return (detection && source.score?.detections[detection.name]?.label[row]) || "plain";
}

export function isMissed(overlay: Overlay, target: number): boolean {
  const outcomes = overlay.detection && overlay.source.score?.detections[overlay.detection.name]?.outcomes;
  if (!outcomes) return false;
  const row = outcomes["alarm"]?.[target] as number;
  return row < 0 || !overlay.visible(row);
}

/** The false alarm rate at which a target's best alarm is declared. */
function firstSeen(overlay: Overlay, target: number): string {
  const far = overlay.detection && overlay.source.score?.detections[overlay.detection.name]?.outcomes["far"]?.[target];
  return typeof far === "number" ? `first seen at ${digits(far, 2)} false alarms per m²` : "no alarm in its halo";
}

function inBox(view: View, px: number, py: number, slack = 12): boolean {
  const { left, top, width, height } = view.box;
  return px > left - slack && px < left + width + slack && py > top - slack && py < top + height + slack;
}

export function drawOverlay(pen: Pen, view: View, overlay: Overlay): void {
  const { source, detection, show } = overlay;
  const { lane, scans, detections } = source.index;
  const bare = !detections.length && !overlay.live;
  const corners = [[lane.x_min, lane.y_min], [lane.x_max, lane.y_min], [lane.x_max, lane.y_max], [lane.x_min, lane.y_max]].map(([x, y]) => view.toScreen(x!, y!));
  if (!bare) {
    pen.path(corners, true, { stroke: SHADOW, width: 2.5, alpha: 0.5 });
    pen.path(corners, true, BORDER);
  }
  if (show.scans || (!detections.length && !overlay.live)) scans.y.forEach((y, i) => drawScan(pen, view, scans.x[i]!, y, scans.heading[i]!, scans.masked.includes(i)));
  const crowded = (detection?.alarms.x.length ?? 0) > 400 && view.along / view.scale > 250;
  const size = crowded ? 4 : 6;
  if (overlay.live) drawVehicle(pen, view, overlay.live);
  if (show.truth) drawTruth(pen, view, overlay, crowded ? 4 : 5);
  if (show.alarms && overlay.second) {
    const { source: other, detection: theirs, visible } = overlay.second;
    drawAlarms(pen, view, other, theirs, visible, overlay.groups && groupAlarms(view, theirs, visible), size, true);
  }
  if (show.alarms && detection) drawAlarms(pen, view, source, detection, overlay.visible, overlay.groups, size);
  if (detection && overlay.selected !== null) {
    const [px, py] = view.toScreen(detection.alarms.x[overlay.selected]!, detection.alarms.y[overlay.selected]!);
    const r = size + 8;
    for (const [stroke, width] of [[SHADOW, 5], ["#ffe45c", 2.4]] as const) pen.ellipse(px, py, r, r, { stroke, width });
    const name = detection.alarms.alarm_id?.[overlay.selected] ?? "";
    const atEnd = px > view.box.left + view.box.width - 90;
    pen.text(px + (atEnd ? -r - 4 : r + 4), py - r + 6, name, { anchor: atEnd ? "end" : "start", fill: "#fff7c2", halo: SHADOW, size: 12, bold: true });
  }
  if (overlay.scan !== null) drawMarked(pen, view, source, overlay.scan);
  if (overlay.live) drawLive(pen, view, overlay, overlay.live);
}

/** Draw each alarm, the strongest last, or their groups. */
function drawAlarms(pen: Pen, view: View, source: Source, detection: Detection, visible: (row: number) => boolean, groups: Group[] | null, size: number, second = false): void {
  const label = (row: number): string => labelOf(source, detection, row);
  if (groups) {
    for (const { px, py, rows } of groups) drawGroup(pen, px, py, rows.map(label), second);
    return;
  }
  const { x, y } = detection.alarms;
  for (let row = x.length - 1; row >= 0; row--) {
    const [px, py] = view.toScreen(x[row]!, y[row]!);
    if (visible(row) && inBox(view, px, py)) drawAlarm(pen, px, py, label(row), size, second);
  }
}

/** A group in words: how many alarms of which kind, and the strongest. */
function groupWords(source: Source, detection: Detection, rows: number[]): string {
  const counts = new Map<string, number>();
  for (const row of rows) {
    const label = labelOf(source, detection, row);
    counts.set(label, (counts.get(label) ?? 0) + 1);
  }
  const kinds = [...counts].filter(([label]) => label !== "plain").map(([label, count]) => `${SHORT[label] ?? label} ${count}`);
  const strongest = Math.max(...rows.map((row) => detection.alarms.confidence[row]!));
  return [`${rows.length} alarms`, ...kinds, `highest confidence ${digits(strongest, 4)}`, "a click comes nearer"].join("\n");
}

function drawScan(pen: Pen, view: View, x: number, y: number, heading: number, masked: boolean): void {
  const [px, py] = view.toScreen(x, y);
  if (!inBox(view, px, py, 20)) return;
  const [ax, ay] = view.toScreen(x + Math.sin(heading), y + Math.cos(heading));
  const size = Math.hypot(ax - px, ay - py) || 1;
  const [ux, uy] = [(ax - px) / size, (ay - py) / size];
  const arrow: [number, number][] = [[px + 7 * ux, py + 7 * uy], [px - 4 * ux - 4 * uy, py - 4 * uy + 4 * ux], [px - 4 * ux + 4 * uy, py - 4 * uy - 4 * ux]];
  pen.path(arrow, true, { fill: masked ? INK["missed"]! : "#ffffff", stroke: SHADOW, width: 1.2 });
}

/** Draw the scan that is marked, and the borders of the ground that it sees ahead. */
function drawMarked(pen: Pen, view: View, { index: { scans, sight } }: Source, scan: number): void {
  const [x, y, heading] = [scans.x[scan]!, scans.y[scan]!, scans.heading[scan]!];
  const [px, py] = view.toScreen(x, y);
  const rings: Style[] = [{ stroke: SHADOW, width: 5 }, { stroke: "#ffe45c", width: 2.4 }];
  for (const style of rings) pen.ellipse(px, py, 12, 12, style);
  drawScan(pen, view, x, y, heading, scans.masked.includes(scan));
  if (!sight || scans.masked.includes(scan)) return;
  const half = (view.extent.x_max - view.extent.x_min) / 2;
  const [sine, cosine] = [Math.sin(heading), Math.cos(heading)];
  const place = (ahead: number, across: number): Point => view.toScreen(x + ahead * sine + across * cosine, y + ahead * cosine - across * sine);
  const [near, far] = sight;
  const corners = [place(near, -half), place(near, half), place(far, half), place(far, -half)];
  for (const style of rings) pen.path(corners, true, { ...style, width: style.width! / 2, dash: [8, 5] });
}

function drawTruth(pen: Pen, view: View, overlay: Overlay, size: number): void {
  const score = overlay.source.score;
  if (!score) return;
  const { truth, objects, halo } = score;
  const deepest = Math.max(...truth.depth.map((depth) => depth ?? 0), 1e-6);
  objects?.x.forEach((x, i) => {
    const [px, py] = view.toScreen(x, objects.y[i]!);
    if (inBox(view, px, py)) drawObject(pen, px, py);
  });
  truth.x.forEach((x, i) => {
    const [px, py] = view.toScreen(x, truth.y[i]!);
    if (!inBox(view, px, py, 60)) return;
    const faded = !overlay.inSubset(i);
    const [rx, ry] = view.turned ? [halo * view.scaleX, halo * view.scale] : [halo * view.scale, halo * view.scaleX];
    if (Math.min(rx, ry) > 11) pen.ellipse(px, py, rx, ry, { ...HALO, alpha: faded ? 0.25 : 0.75 });
    const depth = truth.depth[i] ?? 0;
    drawTarget(pen, px, py, truth.kind[i]!, depth / deepest, isMissed(overlay, i), faded, size);
  });
  if (view.scale * halo > 26) labelTargets(pen, view, overlay, score);
}

const [LETTER, SYMBOL] = [6.2, 7]; // px: breadth of a letter of a label, and half that of a target's symbol

/** Write kind and depth below a target, or above it, or nowhere: no label covers another one, or another target. */
function labelTargets(pen: Pen, view: View, overlay: Overlay, { truth }: NonNullable<Source["score"]>): void {
  const places = truth.x.map((x, i): [number, Point] => [i, view.toScreen(x, truth.y[i]!)]).filter(([, [px, py]]) => inBox(view, px, py, 60));
  const taken = places.map(([, [px, py]]) => [px - SYMBOL, py - SYMBOL, px + SYMBOL, py + SYMBOL] as const);
  for (const [i, [px, py]] of places) {
    if (!overlay.inSubset(i)) continue;
    const words = `${truth.kind[i]} ${fixed(100 * (truth.depth[i] ?? 0), 1)} cm`;
    const half = (LETTER * words.length) / 2;
    const baseline = [py + 21, py - 13].find((y) => taken.every(([left, top, right, bottom]) => px + half < left || px - half > right || y + 4 < top || y - 10 > bottom));
    if (baseline === undefined) continue;
    taken.push([px - half, baseline - 10, px + half, baseline + 4]);
    pen.text(px, baseline, words, { fill: "#ffffff", halo: SHADOW, size: 11, anchor: "middle" });
  }
}

const STOP = "#ff7a59";

/** Draw the way of the vehicle, where it could stop, and the vehicle: all below the alarms, so that it hides none. */
function drawVehicle(pen: Pen, view: View, live: Live): void {
  const points = live.track.map(({ x, y }) => view.toScreen(x, y));
  if (points.length > 1) pen.path(points, false, { stroke: "#ffe45c", width: 1.5, alpha: 0.8 });
  const { here } = live;
  if (!here) return;
  if (live.stopping !== null) {
    const ahead = live.front + live.stopping;
    const [sine, cosine] = [Math.sin(here.heading), Math.cos(here.heading)];
    const half = (view.extent.x_max - view.extent.x_min) / 2;
    const ends = [-half, half].map((across) => view.toScreen(here.x + ahead * sine + across * cosine, here.y + ahead * cosine - across * sine));
    pen.path(ends, false, { stroke: SHADOW, width: 4, alpha: 0.6 });
    pen.path(ends, false, { stroke: STOP, width: 2, dash: [9, 5] });
  }
  const [px, py] = view.toScreen(here.x, here.y);
  pen.ellipse(px, py, 12, 12, { stroke: SHADOW, width: 5.5 });
  pen.ellipse(px, py, 12, 12, { stroke: "#ffe45c", width: 3 });
  drawScan(pen, view, here.x, here.y, here.heading, false);
}

/** Draw what a live run adds to its alarms: octagons about those to brake for, and distances. */
function drawLive(pen: Pen, view: View, overlay: Overlay, live: Live): void {
  const own = overlay.detection?.name === "live";
  const labelled = new Set(live.ahead(live.least).slice(0, live.labelled).map(({ alarm }) => alarm.id));
  for (const alarm of live.alarms.values()) {
    const [px, py] = view.toScreen(alarm.x, alarm.y);
    if (!overlay.show.alarms || alarm.confidence < live.least || !inBox(view, px, py)) continue;
    const left = live.distance(alarm);
    if (!own) drawAlarm(pen, px, py, "plain");
    const late = live.urgent(alarm);
    if (late) drawLate(pen, px, py);
    if (left !== null && labelled.has(alarm.id)) pen.text(px + 11, py - 8, `${fixed(left, 1)} m`, { fill: late ? "#ffd2c4" : "#ffffff", halo: SHADOW, size: 11, bold: late });
  }
}

/** An alarm that the vehicle must brake for: an octagon about its ring. */
function drawLate(pen: Pen, x: number, y: number): void {
  const corners = Array.from({ length: 8 }, (_, i): [number, number] => [x + 11 * Math.cos(((i + 0.5) * Math.PI) / 4), y + 11 * Math.sin(((i + 0.5) * Math.PI) / 4)]);
  pen.path(corners, true, { stroke: SHADOW, width: 4.5 });
  pen.path(corners, true, { stroke: STOP, width: 2.2 });
}

/** An alarm under the pointer. */
function alarmHit({ source, live }: Overlay, detection: Detection, row: number): Hit {
  const { alarms } = detection;
  const label = labelOf(source, detection, row);
  const ahead = live?.alarms.get(alarms.alarm_id?.[row] ?? "");
  if (live && ahead && detection.name === "live") return { kind: "alarm", row, words: live.words(ahead).replaceAll(", ", "\n") };
  const words = `${alarms.alarm_id?.[row] ?? ""}\n${LABELS[label] ?? label}\nconfidence ${digits(alarms.confidence[row], 4)} (rank ${row + 1})`;
  return { kind: "alarm", row, words };
}

/** What lies under the pointer, alarms first. */
export function hitTest(view: View, overlay: Overlay, px: number, py: number): Hit | null {
  const { source, detection, show } = overlay;
  const near = (x: number[], y: number[], keep: (row: number) => boolean): number => {
    let best = -1;
    let least = 13;
    for (let row = 0; row < x.length; row++) {
      if (!keep(row)) continue;
      const [sx, sy] = view.toScreen(x[row]!, y[row]!);
      const away = Math.hypot(sx - px, sy - py);
      if (away < least) [least, best] = [away, row];
    }
    return best;
  };
  if (show.alarms && detection && overlay.groups) {
    const group = groupAt(overlay.groups, px, py);
    if (group?.rows.length === 1) return alarmHit(overlay, detection, group.rows[0]!);
    if (group) return { kind: "group", row: group.rows[0]!, words: groupWords(source, detection, group.rows) };
  } else if (show.alarms && detection) {
    const { alarms } = detection;
    const row = near(alarms.x, alarms.y, overlay.visible);
    if (row >= 0) return alarmHit(overlay, detection, row);
  }
  const score = source.score;
  if (show.truth && score) {
    const row = near(score.truth.x, score.truth.y, () => true);
    if (row >= 0) {
      const { target_id, kind, depth } = score.truth;
      const fate = isMissed(overlay, row) ? `missed at this threshold,\n${firstSeen(overlay, row)}` : "found at this threshold";
      return { kind: "target", row, words: `${target_id[row]}: ${kind[row]}, ${fixed(100 * (depth[row] ?? NaN), 1)} cm deep\n${fate}` };
    }
    const objects = score.objects;
    const other = objects ? near(objects.x, objects.y, () => true) : -1;
    if (objects && other >= 0) return { kind: "object", row: other, words: `${objects.object_id[other]}: ${objects.kind[other]} (no target)` };
  }
  if (source.index.run) {
    const row = near(source.index.scans.x, source.index.scans.y, () => true);
    if (row >= 0) return { kind: "scan", row, words: `scan ${row}` };
  }
  return null;
}

function drawUnseen(pen: Pen): void {
  pen.path([[0, 0], [20, 0], [20, 20], [0, 20]], true, { fill: colour("unseen") });
  for (const at of [-5, 5, 15, 25]) pen.path([[at, 20], [at + 10, 0]], false, { stroke: colour("hatch"), width: 2 });
}

/** The symbols in sight, drawn by the same hand as the picture's. */
export function showLegend(list: HTMLElement, overlay: Overlay): void {
  list.replaceChildren();
  const add = (words: string, ...draws: ((pen: Pen) => void)[]): void => {
    const icons = draws.map((draw) => {
      const pen = new SvgPen();
      draw(pen);
      const icon = svg("svg", { width: 20, height: 20, viewBox: "0 0 20 20", "aria-hidden": "true" });
      const parsed = new DOMParser().parseFromString(pen.svg(20, 20), "image/svg+xml");
      icon.append(...Array.from(parsed.documentElement.childNodes, (node) => document.importNode(node, true)));
      return icon;
    });
    list.append(make("li", {}, ...icons, words));
  };
  const { source, detection, second } = overlay;
  const labels = new Set(detection?.alarms.x.map((_, row) => labelOf(source, detection, row)) ?? []);
  const short: Record<string, string> = { detection: "hit", false: "false alarm", ignored: "in halo", outside: "outside", plain: "alarm" };
  for (const label of ["plain", "detection", "false", "ignored", "outside"]) if (labels.has(label)) add(short[label]!, (pen) => drawAlarm(pen, 10, 10, label, 5.5));
  if (overlay.groups) add("so many alarms", (pen) => drawGroup(pen, 10, 10, ["plain", "plain", "plain"]));
  if (overlay.groups && labels.has("detection")) add("a hit among them", (pen) => drawGroup(pen, 10, 10, ["plain", "detection"]));
  if (overlay.live && overlay.live.stopping !== null) add("brake or stop", (pen) => drawLate(pen, 10, 10));
  if (second) add("alarm of B", (pen) => drawAlarm(pen, 10, 10, "plain", 5, true));
  const score = overlay.show.truth ? source.score : null;
  for (const kind of score?.kinds ?? []) add(kind, (pen) => drawTarget(pen, 10, 10, kind, 0.4, false));
  const missed = new Set(score?.truth.kind.filter((_, target) => isMissed(overlay, target)));
  if (missed.size) add("missed", ...[...missed].sort().map((kind) => (pen: Pen) => drawTarget(pen, 10, 10, kind, 0.4, true)));
  if (score?.truth.x.length) add(`halo, ${digits(score.halo)} m`, (pen) => pen.ellipse(10, 10, 8, 8, HALO));
  if (score?.objects?.x.length) add("no target", (pen) => drawObject(pen, 10, 10));
  if (detection || overlay.live) add("lane", (pen) => pen.path([[1, 5], [19, 5], [19, 15], [1, 15]], true, BORDER));
  if (overlay.gaps) add("seen by no scan", drawUnseen);
}

export function secondOf(sources: Source[], a: Choice, b: Choice): { source: Source; detection: Detection } | null {
  const source = sources[b.source];
  if (!source) return null;
  const detection = detectionOf(source, b.set);
  const own = sources[a.source] && detectionOf(sources[a.source]!, a.set);
  return detection && (detection !== own || b.source !== a.source) ? { source, detection } : null;
}
