import uPlot from "uplot";
import { colour, digits, el, fixed, make } from "./dom";
import type { Curve, Score, Scored, ScoredTarget, Source } from "./types";

/** Curve of a subset; none when the truth has no such targets. */
export function curveOf(score: Score | null, detection: string, kind: string | null, depth: string | null): Curve | undefined {
  const scored = score?.detections[detection];
  const own = scored?.curves.find((one) => one.kind === kind && one.depth === depth);
  return scored && own && { ...scored.shared, ...own };
}

/** Falling thresholds of a detection, nothing declared first: of the score or, without one, of the confidences. */
export function thresholdsOf(source: Source, detection: string): (number | null)[] {
  const curve = curveOf(source.score, detection, null, null);
  if (curve) return curve.threshold;
  const found = source.index.detections.find((one) => one.name === detection);
  return [null, ...[...new Set(found?.alarms.confidence ?? [])].sort((a, b) => b - a)];
}

/** At which false alarm rate a detection is shown first, in words. */
export function pointWords(curve: Curve | undefined): string {
  if (!curve?.point) return "";
  const { far_asked: asked, far_allowed: allowed, few_halos: room } = curve.point;
  const rough = room ? ` Chance is rough: there is room for ${fixed(room, 0)} halos only.` : "";
  if (allowed <= asked) return `Opened at ${digits(asked)} false alarms per m².${rough}`;
  return `Opened at one false alarm, ${digits(allowed, 2)} per m²: ${fixed(curve.area, 1)} m² are too small for ${digits(asked)}.${rough}`;
}

/** What is found at which cost, as the sentence that the page begins with. */
export function answerWords(a: Operating, b?: Operating): string {
  const found = ({ curve, row }: Operating): string => {
    const [pd, count] = [digits(curve.pd[row], 2), curve.n_false[row]!];
    const targets = [curve.kind, "targets", curve.depth && `at ${curve.depth}`].filter(Boolean).join(" ");
    return `${curve.n_detected[row]} of ${curve.n_targets} ${targets} found (Pd ${pd}, ${interval(curve.pd_low[row], curve.pd_high[row])}) with ${count} false alarm${count === 1 ? "" : "s"} on ${digits(curve.area)} m².`;
  };
  return b ? `A: ${found(a)} B: ${found(b)}` : found(a);
}

/** The lowest threshold of another curve that has no more false alarms. */
export function equalFalse(curve: Curve, most: number): number {
  let row = 0;
  while (row + 1 < curve.n_false.length && curve.n_false[row + 1]! <= most) row++;
  return row;
}

/** Highest Pd, with its interval and chance, at every distinct FAR: what a step curve needs. */
function steps(curve: Curve): [number[], ...(number | null)[][]] {
  const rows: number[] = [];
  curve.far.forEach((far, row) => {
    if (rows.length && curve.far[rows[rows.length - 1]!] === far) rows[rows.length - 1] = row;
    else rows.push(row);
  });
  const take = (column: (number | null)[]): (number | null)[] => rows.map((row) => column[row] ?? null);
  return [rows.map((row) => curve.far[row]!), take(curve.pd), take(curve.pd_low), take(curve.pd_high), take(curve.chance ?? [])];
}

export interface Operating { curve: Curve; row: number }

export class RocPlot {
  private plot: uPlot | null = null;
  private now: { a?: Operating; b?: Operating } = {};
  private readonly home = el("roc-plot");

  constructor(private readonly chosen: (row: number) => void) {
    new ResizeObserver(() => this.resize()).observe(this.home);
  }

  private size(): { width: number; height: number } {
    const alone = document.body.classList.contains("scored");
    return { width: Math.max(this.home.clientWidth, 100), height: alone ? Math.max(window.innerHeight - 420, 260) : window.innerHeight > 950 ? 300 : 214 };
  }

  private resize(): void {
    const size = this.size();
    if (this.plot && (this.plot.width !== size.width || this.plot.height !== size.height)) this.plot.setSize(size);
  }

  /** Draw curves anew: another result, subset or theme. */
  show(a: Operating | undefined, b: Operating | undefined, none: string): void {
    this.plot?.destroy();
    this.plot = null;
    this.now = { ...(a && { a }), ...(b && { b }) };
    this.home.replaceChildren();
    if (!a) {
      this.home.append(make("p", { class: "none" }, none));
      return;
    }
    const stepped = uPlot.paths.stepped!({ align: 1 });
    const own = steps(a.curve);
    const tables: uPlot.AlignedData[] = [own as uPlot.AlignedData];
    if (b) tables.push(steps(b.curve).slice(0, 4) as uPlot.AlignedData);
    const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), size: 4 }, font: "11px system-ui", labelFont: "11px system-ui" };
    const most = Math.max(...a.curve.far, ...(b ? b.curve.far : []), 1e-9);
    const series: uPlot.Series[] = [
      {},
      { stroke: colour("accent"), width: 2, paths: stepped, points: { show: false }, spanGaps: true },
      { stroke: "transparent", paths: stepped, points: { show: false }, spanGaps: true },
      { stroke: "transparent", paths: stepped, points: { show: false }, spanGaps: true },
      { stroke: colour("soft"), width: 1.5, dash: [2, 3], paths: stepped, points: { show: false }, spanGaps: true },
    ];
    if (b) {
      const bound = { stroke: "transparent", paths: stepped, points: { show: false }, spanGaps: true };
      series.push({ stroke: colour("false"), width: 2, dash: [5, 4], paths: stepped, points: { show: false }, spanGaps: true }, bound, bound);
    }
    const point = (row: number): number => row;
    this.plot = new uPlot(
      {
        ...this.size(),
        legend: { show: false },
        cursor: { drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false, range: [0, most * 1.12] }, y: { range: [0, 1.02] } },
        axes: [
          { ...axis, label: "false alarms per m²", labelSize: 16, size: 30 },
          { ...axis, label: "Pd", labelSize: 16, size: 38 },
        ],
        series,
        bands: [{ series: [3, 2] as [number, number], fill: colour("band") }, ...(b ? [{ series: [7, 6] as [number, number], fill: colour("band-b") }] : [])],
        hooks: { draw: [(u) => this.points(u)] },
      },
      (tables.length > 1 ? uPlot.join(tables) : own) as uPlot.AlignedData,
      this.home,
    );
    this.plot.over.addEventListener("click", (event) => this.chosen(point(this.nearest(event))));
    this.describe();
  }

  /** Move the operating points only. */
  move(a: Operating | undefined, b: Operating | undefined): void {
    this.now = { ...(a && { a }), ...(b && { b }) };
    this.plot?.redraw(false);
    this.describe();
  }

  private describe(): void {
    const { a } = this.now;
    this.home.setAttribute(
      "aria-label",
      a ? `ROC. At this threshold Pd ${digits(a.curve.pd[a.row])}, by chance ${digits(a.curve.chance?.[a.row], 2)}, false alarms per square metre ${digits(a.curve.far[a.row])}` : "ROC: not scored",
    );
  }

  private nearest(event: MouseEvent): number {
    const u = this.plot!;
    const { curve } = this.now.a!;
    const box = u.over.getBoundingClientRect();
    let best = 0;
    let least = Infinity;
    curve.far.forEach((far, row) => {
      const dx = u.valToPos(far, "x") - (event.clientX - box.left);
      const dy = u.valToPos(curve.pd[row] ?? 0, "y") - (event.clientY - box.top);
      const away = dx * dx + dy * dy;
      if (away < least) [least, best] = [away, row];
    });
    return best;
  }

  private points(u: uPlot): void {
    const c = u.ctx;
    const density = window.devicePixelRatio || 1;
    c.save();
    c.beginPath();
    c.rect(u.bbox.left - 6, u.bbox.top - 6, u.bbox.width + 12, u.bbox.height + 12);
    c.clip();
    for (const [one, ink, dash] of [[this.now.b, colour("false"), [5, 4]], [this.now.a, colour("accent"), []]] as const) {
      if (!one) continue; // the series are functions of the FAR: the step at none is drawn here
      c.strokeStyle = ink;
      c.setLineDash(dash.map((length) => length * density));
      c.lineWidth = 2 * density;
      c.beginPath();
      const first = u.valToPos(one.curve.far[0]!, "x", true);
      c.moveTo(first, u.valToPos(0, "y", true));
      c.lineTo(first, u.valToPos(steps(one.curve)[1][0] ?? 0, "y", true));
      c.stroke();
    }
    for (const [one, ink] of [[this.now.b, colour("false")], [this.now.a, colour("accent")]] as const) {
      if (!one || one.curve.far.length > 300) continue;
      c.fillStyle = ink;
      one.curve.far.forEach((far, row) => {
        c.beginPath();
        c.arc(u.valToPos(far, "x", true), u.valToPos(one.curve.pd[row] ?? 0, "y", true), 2.2 * density, 0, 2 * Math.PI);
        c.fill();
      });
    }
    for (const [one, ink] of [[this.now.b, colour("false")], [this.now.a, colour("accent")]] as const) {
      if (!one) continue;
      const { curve, row } = one;
      const x = u.valToPos(curve.far[row]!, "x", true);
      const y = u.valToPos(curve.pd[row] ?? 0, "y", true);
      c.strokeStyle = ink;
      c.setLineDash([]);
      c.lineWidth = 1.4 * density;
      c.beginPath();
      c.moveTo(u.valToPos(curve.far_low[row]!, "x", true), y);
      c.lineTo(u.valToPos(curve.far_high[row]!, "x", true), y);
      c.moveTo(x, u.valToPos(curve.pd_low[row] ?? 0, "y", true));
      c.lineTo(x, u.valToPos(curve.pd_high[row] ?? 0, "y", true));
      c.stroke();
      c.beginPath();
      c.arc(x, y, 5 * density, 0, 2 * Math.PI);
      c.fillStyle = ink;
      c.fill();
      c.strokeStyle = colour("card");
      c.stroke();
    }
    this.nameChance(u);
    c.restore();
  }

  /** Write at the end of the dotted curve what it is, on the side where the plot is. */
  private nameChance(u: uPlot): void {
    const curve = this.now.a?.curve;
    const last = curve?.chance?.[curve.far.length - 1];
    if (!curve || last === null || last === undefined) return;
    const density = window.devicePixelRatio || 1;
    u.ctx.font = `${11 * density}px system-ui`;
    u.ctx.textAlign = "right";
    u.ctx.fillStyle = colour("soft");
    u.ctx.fillText("chance", u.valToPos(curve.far[curve.far.length - 1]!, "x", true), u.valToPos(last, "y", true) + (last < 0.5 ? -5 : 14) * density);
  }
}

const interval = (low: number | null | undefined, high: number | null | undefined): string => `${digits(low, 2)} to ${digits(high, 2)}`;

/** Whether a target is found at an operating point: by its confidence or, where thresholds are not told, by the rate that is allowed. */
function foundAt({ curve, row }: Operating, { far, confidence }: ScoredTarget): boolean {
  const [allowed, threshold] = [curve.allowed?.[row], curve.threshold[row] ?? null];
  if (allowed !== undefined) return far !== null && far <= allowed;
  return threshold !== null && confidence !== null && confidence >= threshold;
}

/** Scores without pictures: operating points by group of targets, and what becomes of each target at the threshold. */
export function showScores(home: HTMLElement, sides: { scored: Scored; at: Operating }[]): void {
  home.replaceChildren();
  const heads = sides.map((_, side) => (sides.length > 1 ? `${"AB"[side]} ` : ""));
  const table = (title: string, columns: string[], rows: (string | Node)[][]): void => {
    const cells = (row: (string | Node)[], tag: "th" | "td"): HTMLElement => make("tr", {}, ...row.map((one) => (one instanceof HTMLTableCellElement ? one : make(tag, {}, one))));
    home.append(make("h2", {}, title), make("table", {}, make("thead", {}, cells(columns, "th")), make("tbody", {}, ...rows.map((row) => cells(row, "td")))));
  };
  const keys = [...new Set(sides.flatMap(({ scored }) => (scored.points ?? []).map((one) => `${one.group}\n${one.far_allowed}`)))];
  const points = keys.map((key) => {
    const [group, far] = key.split("\n") as [string, string];
    const found = sides.flatMap(({ scored }) => {
      const one = scored.points?.find((point) => `${point.group}\n${point.far_allowed}` === key);
      const bounds = one ? make("small", {}, ` ${interval(one.pd_low, one.pd_high)}`) : "";
      return one ? [`${one.n_detected} of ${one.n_targets}`, make("td", {}, digits(one.pd, 3), bounds), digits(one.chance, 2), String(one.n_false)] : ["–", "–", "–", "–"];
    });
    return [group, digits(Number(far), 3), ...found];
  });
  table("Found at which false alarm rate", ["targets", "at most, per m²", ...heads.flatMap((head) => [`${head}found`, "Pd, interval", "chance", "false"])], points);
  const targets = new Map(sides.flatMap(({ scored }) => (scored.targets ?? []).map((one) => [one.target_id, one] as const)));
  if (!targets.size) return;
  const fates = [...targets.values()].map(({ target_id, kind, depth }) => {
    const fate = sides.flatMap(({ scored, at }) => {
      const one = scored.targets?.find((target) => target.target_id === target_id);
      if (!one) return ["–", "–"];
      const found = foundAt(at, one);
      return [make("td", { class: found ? "hit" : "missed" }, found ? "found" : "missed"), one.far === null ? "never" : digits(one.far, 3)];
    });
    return [target_id, `${kind}, ${depth === null ? "depth not known" : `${fixed(100 * depth, 1)} cm`}`, ...fate];
  });
  table("What becomes of each target at the threshold", ["target", "kind", ...heads.flatMap((head) => [`${head}is`, "first seen, per m²"])], fates);
}

/** Counts at the operating point; with two results side by side, the second at no more false alarms than the first. */
export function showCounts(table: HTMLTableElement, a: Operating | undefined, b: Operating | undefined, alarms: number, names: [string, string]): void {
  table.replaceChildren();
  const row = (head: string, ...cells: (string | Node)[]): void => {
    table.append(make("tr", {}, make("th", { scope: "row" }, head), ...cells.map((cell) => (cell instanceof Node && cell.nodeName === "TD" ? cell : make("td", {}, cell)))));
  };
  if (!a) {
    row("alarms shown", make("td", { class: "big" }, String(alarms)));
    return;
  }
  const both = b ? [a, b] : [a];
  const cells = (cell: (one: Operating) => Node): Node[] => both.map(cell);
  const percent = Math.round(100 * a.curve.level);
  if (b) row("result", make("td", {}, make("b", {}, "A "), names[0]), make("td", {}, make("b", {}, "B "), names[1]));
  row("found", ...cells(({ curve, row: r }) => make("td", { class: "big hit" }, `${curve.n_detected[r]} of ${curve.n_targets}`)));
  row("missed", ...cells(({ curve, row: r }) => make("td", { class: "missed" }, String(curve.n_targets - curve.n_detected[r]!))));
  row("false alarms", ...cells(({ curve, row: r }) => make("td", { class: "big false" }, String(curve.n_false[r]))));
  row("Pd", ...cells(({ curve, row: r }) => make("td", {}, `${digits(curve.pd[r], 3)} `, make("small", {}, interval(curve.pd_low[r], curve.pd_high[r])))));
  row("chance", ...cells(({ curve, row: r }) => make("td", {}, digits(curve.chance?.[r], 2))));
  row("FAR, per m²", ...cells(({ curve, row: r }) => make("td", {}, `${digits(curve.far[r], 3)} `, make("small", {}, interval(curve.far_low[r], curve.far_high[r])))));
  table.title = `Small figures: exact ${percent} % intervals. Chance: the Pd of alarms that know nothing of the targets.${b ? " B stands at its lowest threshold with no more false alarms than A." : ""}`;
}
