import { AlarmPanel } from "./alarm";
import type { Colours } from "./colour";
import { COLOUR_MAPS } from "./colormaps";
import { detectionOf, HALF, layerOf, loadEvidence, setLabel, Tiles } from "./data";
import { checkRadio, colour, digits, el, fitted, fixed, options } from "./dom";
import { alarmRows, asCsv, asGeoJson, download } from "./exports";
import { savePng, saveSvg, type FigureParts } from "./figure";
import { extentOf, geographic } from "./geo";
import { canvasPen, colourBar, Picture, type Palette } from "./lane";
import { AlarmList } from "./list";
import type { Live, LiveAlarm, LiveRows } from "./live";
import { drawOverlay, hitTest, labelOf, secondOf, showLegend, type Overlay } from "./overlay";
import { Notes } from "./notes";
import type { Pen } from "./pen";
import { curveOf, equalFalse, RocPlot, showCounts, thresholdsOf, type Operating } from "./roc";
import { LABELS } from "./symbols";
import type { Choice, Detection, Note, Source } from "./types";
import { View, type Box } from "./view";

/** Length of lane in sight when the picture follows the vehicle, and how much of it lies behind the vehicle, m. */
const FOLLOWED = 27;
const BEHIND = 6;

export type Compare = "off" | "swipe" | "blink";

export class App {
  a: Choice;
  b: Choice;
  compare: Compare = "off";
  flipped = false;
  divide = 0.5;
  colours: Colours = { map: "viridis", floor: -5, range: 35 };
  smooth = false;
  show = { alarms: true, truth: true, scans: false };
  row = 0;
  kind: string | null = null;
  depth: string | null = null;
  selected: number | null = null;
  ticked = new Set<number>();
  live: Live | null = null;
  readonly view: View;
  readonly picture: Picture;
  private readonly tiles: Tiles;
  private readonly panel: AlarmPanel;
  private readonly list: AlarmList;
  private readonly roc: RocPlot;
  private thresholds: (number | null)[] = [null];
  readonly notes: Notes;
  private waiting = 0;
  private fitting = true;
  private marked = false;
  follow = false;
  private evidence: { key: string; values: Float32Array | null } = { key: "", values: null };
  private blinking: number | undefined;

  constructor(readonly sources: Source[]) {
    this.notes = new Notes(sources);
    const first = sources[0]!;
    const [polarization, subband] = first.index.channel;
    const main = first.index.detections[0]?.name ?? first.index.layers[0]?.detection ?? "";
    this.a = { source: 0, set: main, polarization, subband };
    const other = sources[1];
    const before = first.index.layers.some((one) => one.detection === "before") ? "before" : (first.index.detections[1]?.name ?? main);
    this.b = other
      ? { source: 1, set: other.index.detections[0]?.name ?? "", polarization: other.index.channel[0], subband: other.index.channel[1] }
      : { ...this.a, set: before };
    this.view = new View(extentOf(sources));
    this.tiles = new Tiles(
      () => this.redraw(),
      (error) => this.complain(error.message),
      (waiting) => el("stage").setAttribute("aria-busy", String(waiting)),
    );
    this.picture = new Picture(sources, this.tiles, this.view);
    this.panel = new AlarmPanel((pol, band) => this.choose("a", { polarization: pol, subband: band }));
    this.list = new AlarmList(
      (row) => this.select(row, true),
      (rows, on) => this.tick(rows, on),
    );
    this.roc = new RocPlot((row) => this.setThreshold(row));
    el("roc").hidden = el("list").hidden = !first.index.detections.length;
    el("overview").hidden = this.view.length < 8 * this.view.breadth;
    this.resized();
    this.picture.recolour(this.colours);
    this.detectionChanged();
    this.showChoices();
    this.showColours();
    const stage = new ResizeObserver(() => this.resized());
    stage.observe(el("stage"));
  }

  get source(): Source {
    return this.sources[this.a.source]!;
  }

  get detection(): Detection | undefined {
    return detectionOf(this.source, this.a.set);
  }

  // ---------------------------------------------------------------- live

  /** A live run is known: take its lane, lattice and channel as the source's. */
  begin(live: Live): void {
    const { index } = this.source;
    const own = this.source.title === "live";
    if (!own) return this.redraw();
    const [polarization, subband] = live.channel;
    this.tiles.drop(this.source.id);
    Object.assign(index, { title: live.title, georeference: live.georeference, channel: live.channel, grid: live.grid, tile_rows: 512 });
    index.layers = live.grid ? [{ detection: "live", stage: "live", polarization, subband, percentiles: { "50": 0 }, levels: [{ file: "", rows: 0 }] }] : [];
    index.detections = [live.detection()];
    this.a = { source: 0, set: "live", polarization, subband };
    this.b = { ...this.a };
    this.picture.recolour(this.colours);
    this.extend(live);
    el("roc").hidden = el("list").hidden = false;
    el("subset").hidden = el("roc-plot").hidden = el("explain").hidden = true;
    this.detectionChanged();
    this.showChoices();
    this.setFollow(live.lane === null || this.view.length > 80);
    this.resized();
  }

  /** Rows of a live run-view came. */
  grow(live: Live, { row, median, halves }: LiveRows): void {
    const { index, id, title } = this.source;
    const layer = index.layers[0];
    if (title !== "live" || !layer || !live.grid) return;
    index.grid = live.grid;
    layer.levels[0]!.rows = live.grid.ny;
    this.picture.repaint(id, 0, this.tiles.put(id, 0, row, live.grid.nx, index.tile_rows, halves));
    if (Math.abs(median - (layer.percentiles["50"] ?? 0)) > 0.75) {
      layer.percentiles["50"] = median;
      this.picture.recolour(this.colours);
    }
    if (live.lane === null) this.extend(live);
  }

  /** Scans and alarms of a live run came. */
  went(live: Live, fresh: LiveAlarm[]): void {
    if (this.source.title === "live") {
      const { index } = this.source;
      const id = this.selected === null ? null : this.detection?.alarms.alarm_id?.[this.selected];
      const ticked = new Set([...this.ticked].map((row) => this.detection?.alarms.alarm_id?.[row]));
      const [least, last] = [this.threshold, this.row >= this.thresholds.length - 1];
      index.detections = [live.detection()];
      const names = index.detections[0]!.alarms.alarm_id!;
      this.thresholds = thresholdsOf(this.source, "live");
      const at = this.thresholds.findIndex((one) => one !== null && least !== null && one <= least);
      this.row = last || least === null ? (last ? this.thresholds.length - 1 : 0) : at < 0 ? this.thresholds.length - 1 : this.thresholds[at] === least ? at : Math.max(at - 1, 0);
      live.least = last ? -Infinity : (least ?? Infinity);
      el<HTMLInputElement>("threshold").max = String(Math.max(this.thresholds.length - 1, 0));
      this.ticked = new Set(names.flatMap((name, row) => (ticked.has(name) ? [row] : [])));
      this.selected = id ? (names.indexOf(id) >= 0 ? names.indexOf(id) : null) : null;
      index.scans = { x: live.track.map((one) => one.x), y: live.track.map((one) => one.y), z: [], heading: live.track.map((one) => one.heading), masked: [] };
      this.evidence.key = "";
      this.showAlarm();
      this.showThreshold();
    }
    const told = fresh.filter((one) => one.confidence >= live.least && !one.final && (live.distance(one) ?? 1) > 0);
    if (told.length) {
      const nearest = told.reduce((a, b) => ((live.distance(b) ?? Infinity) < (live.distance(a) ?? Infinity) ? b : a));
      this.say(`New alarm: ${live.words(nearest)}${told.length > 1 ? `, and ${told.length - 1} more` : ""}`);
    }
    this.keepUp(live);
    this.redraw();
  }

  setFollow(follow: boolean): void {
    this.follow = follow;
    el("follow").setAttribute("aria-pressed", String(follow));
    if (!follow || !this.live) return;
    this.fitting = false;
    this.view.fill = true;
    this.view.scale = Math.min(this.view.along / Math.min(FOLLOWED, 6 * this.view.breadth), (0.96 * this.view.across) / this.view.breadth);
    this.keepUp(this.live);
    this.redraw();
  }

  private keepUp(live: Live): void {
    if (!this.follow || !live.here) return;
    this.view.x = (this.view.extent.x_min + this.view.extent.x_max) / 2;
    this.view.y = live.here.y + this.view.along / this.view.scale / 2 - BEHIND;
  }

  /** A lane without an end is as long as what was seen of it. */
  private extend(live: Live): void {
    const { grid, lane } = live;
    if (!grid) return;
    const x = { x_min: grid.x - grid.dx / 2, x_max: grid.x + (grid.nx - 0.5) * grid.dx };
    const seen = grid.y + Math.max(grid.ny * grid.dy, 20);
    this.source.index.lane = lane ?? { x_min: -1.5, x_max: 1.5, y_min: grid.y, y_max: seen };
    this.view.extent = lane ? { ...x, y_min: Math.min(lane.y_min, grid.y), y_max: lane.y_max } : { ...x, y_min: grid.y, y_max: seen };
    el("overview").hidden = this.view.length < 8 * this.view.breadth;
  }

  // ---------------------------------------------------------------- choices

  choose(side: "a" | "b", change: Partial<Choice>): void {
    const before = this.detection;
    const choice = { ...this[side], ...change };
    const layers = this.sources[choice.source]!.index.layers.filter((one) => one.detection === choice.set);
    if (layers.length && !layers.some((one) => one.polarization === choice.polarization)) choice.polarization = layers[0]!.polarization;
    if (layers.length && !layers.some((one) => one.subband === choice.subband)) choice.subband = layers[0]!.subband;
    this[side] = choice;
    if (this.detection !== before) this.detectionChanged();
    else if (side === "b") this.scoresChanged();
    this.showChoices();
    this.showAlarm();
    this.redraw();
  }

  setCompare(compare: Compare): void {
    this.compare = compare;
    this.flipped = false;
    clearInterval(this.blinking);
    if (compare === "blink" && !window.matchMedia("(prefers-reduced-motion: reduce)").matches)
      this.blinking = window.setInterval(() => this.flip(), 700);
    checkRadio("compare", compare);
    this.showChoices();
    this.scoresChanged();
    this.say(compare === "off" ? "Picture A only" : `Compare A with B: ${compare}`);
  }

  flip(): void {
    this.flipped = !this.flipped;
    this.redraw();
  }

  private showChoices(): void {
    for (const side of ["a", "b"] as const) {
      const choice = this[side];
      const sets = this.sources.flatMap((source) => {
        const names = [...new Set(source.index.layers.map((one) => one.detection))];
        const group = this.sources.length > 1 ? source.title : undefined;
        return names.map((name) => ({ value: `${source.id}/${name}`, label: setLabel(source, name), ...(group && { group }) }));
      });
      options(el<HTMLSelectElement>(`${side}-set`), sets, `${choice.source}/${choice.set}`);
      const layers = this.sources[choice.source]!.index.layers.filter((one) => one.detection === choice.set);
      const unique = (values: string[]): { value: string; label: string }[] => [...new Set(values)].map((value) => ({ value, label: value }));
      options(el<HTMLSelectElement>(`${side}-pol`), unique(layers.map((one) => one.polarization)), choice.polarization);
      options(el<HTMLSelectElement>(`${side}-band`), unique(layers.map((one) => one.subband)), choice.subband);
    }
    const layered = this.source.index.layers.length > 0;
    el("choice-a").hidden = el("display").hidden = !layered;
    el("choice-b").hidden = this.compare === "off";
    document.querySelector<HTMLElement>('[aria-label="Compare A with B"]')!.hidden = !layered;
  }

  nextChannel(name: "polarization" | "subband", step = 1): void {
    const values = [...new Set(this.source.index.layers.filter((one) => one.detection === this.a.set).map((one) => one[name]))];
    const next = values[(values.indexOf(this.a[name]) + step + values.length) % values.length];
    if (next === undefined) return;
    this.choose("a", { [name]: next });
    this.say(`${this.a.polarization}, ${this.a.subband} gigahertz`);
  }

  // ---------------------------------------------------------------- colours

  setColours(change: Partial<Colours>): void {
    performance.mark("flgpr:recolour-start");
    this.colours = { ...this.colours, ...change };
    this.picture.recolour(this.colours);
    this.showColours();
    this.draw();
    performance.measure("flgpr:recolour", "flgpr:recolour-start");
    this.drawOverview();
    this.panel.recolour(this.colours);
  }

  private showColours(): void {
    const { map, floor, range } = this.colours;
    const names = Object.keys(COLOUR_MAPS).map((name) => ({ value: name, label: name }));
    options(el<HTMLSelectElement>("map"), names, map);
    el<HTMLInputElement>("floor").value = String(floor);
    el<HTMLInputElement>("range").value = String(range);
    el("floor-out").textContent = `${digits(floor)} dB`;
    el("range-out").textContent = `${range} dB`;
  }

  // ---------------------------------------------------------------- thresholds, subsets, counts

  private detectionChanged(): void {
    this.thresholds = this.detection ? thresholdsOf(this.source, this.detection.name) : [null];
    this.row = this.thresholds.length - 1;
    this.selected = null;
    this.ticked.clear();
    el<HTMLInputElement>("threshold").max = String(Math.max(this.thresholds.length - 1, 0));
    const score = this.source.score;
    if (this.kind !== null && !score?.kinds.includes(this.kind)) this.kind = null;
    if (this.depth !== null && !score?.depths.includes(this.depth)) this.depth = null;
    const all = [{ value: "", label: "all" }];
    options(el<HTMLSelectElement>("kind"), [...all, ...(score?.kinds ?? []).map((value) => ({ value, label: value }))], this.kind ?? "");
    options(el<HTMLSelectElement>("depth"), [...all, ...(score?.depths ?? []).map((value) => ({ value, label: value }))], this.depth ?? "");
    this.showAlarm();
    this.scoresChanged();
  }

  setSubset(kind: string | null, depth: string | null): void {
    this.kind = kind;
    this.depth = depth;
    this.scoresChanged();
  }

  setThreshold(row: number): void {
    this.row = Math.min(Math.max(row, 0), this.thresholds.length - 1);
    if (this.live) {
      this.live.least = this.source.title !== "live" || this.row >= this.thresholds.length - 1 ? -Infinity : (this.threshold ?? Infinity);
      this.live.report();
    }
    const [a, b] = this.operating();
    this.roc.move(a, b);
    this.showThreshold();
    this.redraw();
  }

  get threshold(): number | null {
    return this.thresholds[this.row] ?? null;
  }

  visible = (row: number): boolean => {
    const threshold = this.threshold;
    return threshold !== null && (this.detection?.alarms.confidence[row] ?? -Infinity) >= threshold;
  };

  private operating(): [Operating | undefined, Operating | undefined] {
    const detection = this.detection;
    const curve = detection && curveOf(this.source.score, detection.name, this.kind, this.depth);
    if (!curve) return [undefined, undefined];
    const a = { curve, row: this.row };
    const second = this.compare === "off" ? null : secondOf(this.sources, this.a, this.b);
    const other = second && curveOf(second.source.score, second.detection.name, this.kind, this.depth);
    return [a, other ? { curve: other, row: equalFalse(other, curve.n_false[this.row]!) } : undefined];
  }

  /** Result, subset or comparison changed: curves, counts, list, picture. */
  scoresChanged(): void {
    const [a, b] = this.operating();
    this.roc.show(a, b);
    this.showThreshold();
    this.redraw();
  }

  private showThreshold(): void {
    const [a, b] = this.operating();
    const slider = el<HTMLInputElement>("threshold");
    slider.value = String(this.row);
    const words = this.threshold === null ? "none" : digits(this.threshold, 4);
    el("threshold-out").textContent = this.threshold === null ? "∞" : words;
    const shown = this.shownRows();
    slider.setAttribute(
      "aria-valuetext",
      a ? `confidence ${words}: ${a.curve.n_detected[this.row]} of ${a.curve.n_targets} found, ${a.curve.n_false[this.row]} false alarms` : `confidence ${words}: ${shown.length} alarms`,
    );
    const second = secondOf(this.sources, this.a, this.b);
    const name = (source: Source, detection: Detection | undefined): string => (this.sources.length > 1 && source.title.split(" ")[0]) || (detection?.name ?? "");
    showCounts(el<HTMLTableElement>("counts"), a, b, shown.length, [name(this.source, this.detection), second ? name(second.source, second.detection) : ""]);
    this.showList();
    showLegend(el("legend"), this.overlay());
  }

  shownRows(): number[] {
    const count = this.detection?.alarms.x.length ?? 0;
    return Array.from({ length: count }, (_, row) => row)
      .filter(this.visible)
      .sort((p, q) => this.detection!.alarms.confidence[q]! - this.detection!.alarms.confidence[p]!);
  }

  private showList(): void {
    const rows = this.shownRows();
    this.list.show({ source: this.source, detection: this.detection, rows, selected: this.selected, ticked: this.ticked, note: (row) => this.note(row) });
    const chosen = this.exportRows().length;
    el("export-count").textContent = this.ticked.size ? `${chosen} selected alarms` : `all ${chosen} alarms shown; tick some in the list for less`;
  }

  // ---------------------------------------------------------------- the selected alarm

  select(row: number | null, move = false): void {
    this.selected = row;
    if (row !== null && move) {
      const before = this.view.y;
      this.view.show(this.detection!.alarms.x[row]!, this.detection!.alarms.y[row]!);
      if (this.follow && this.view.y !== before) this.setFollow(false);
    }
    this.showAlarm();
    this.showList();
    this.redraw();
    if (row !== null) this.say(this.inWords(row));
  }

  step(by: number): void {
    const rows = this.shownRows();
    if (!rows.length) return this.say("No alarm at this threshold");
    const at = this.selected === null ? -1 : rows.indexOf(this.selected);
    const next = at < 0 ? (by > 0 ? 0 : rows.length - 1) : (at + by + rows.length) % rows.length;
    this.select(rows[next]!, true);
  }

  private inWords(row: number): string {
    const { alarms } = this.detection!;
    const label = labelOf(this.source, this.detection, row);
    const place = `${fixed(alarms.y[row]!, 2)} metres down-track, ${fixed(Math.abs(alarms.x[row]!), 2)} metres ${alarms.x[row]! < 0 ? "left" : "right"}`;
    return `${alarms.alarm_id?.[row] ?? "alarm"}, ${LABELS[label]}, confidence ${digits(alarms.confidence[row], 4)}, ${place}`;
  }

  private showAlarm(): void {
    const row = this.selected;
    const detection = this.detection;
    const was = el("alarm").hidden;
    el("alarm").hidden = row === null;
    if (row === null || !detection) {
      this.panel.hide();
      return;
    }
    if (was) this.resized();
    const { alarms } = detection;
    const rank = [...alarms.confidence].filter((one) => one > alarms.confidence[row]!).length + 1;
    const scored = this.source.score?.detections[detection.name];
    const target = scored?.target[row] ?? -1;
    const truth = this.source.score?.truth;
    el("alarm-title").textContent = alarms.alarm_id?.[row] ?? `alarm-${row + 1}`;
    const label = labelOf(this.source, detection, row);
    const what = target >= 0 && truth ? `${label === "detection" ? "hit of" : "in the halo of"} ${truth.target_id[target]} (${truth.kind[target]}, ${fixed(100 * (truth.depth[target] ?? NaN), 1)} cm), ${fixed(scored?.distance[row] ?? NaN, 2)} m off` : label === "plain" ? "" : LABELS[label]!;
    el("alarm-facts").textContent = [`rank ${rank}`, `confidence ${digits(alarms.confidence[row], 4)}`, what].filter(Boolean).join(" · ");
    el("alarm-facts").title = this.inWords(row);
    const note = this.note(row);
    checkRadio("verdict", note.verdict);
    const field = el<HTMLInputElement>("note");
    if (document.activeElement !== field) field.value = note.text;
    const number = this.source.index.detections.indexOf(detection);
    const key = `${this.a.source}/${number}/${row}`;
    if (this.evidence.key === key) this.panel.show(this.source, detection, row, this.a, this.evidence.values, this.colours);
    else void this.fetchEvidence(key, number, row);
  }

  private async fetchEvidence(key: string, number: number, row: number): Promise<void> {
    const source = this.source;
    const stored = source.index.detections[number]?.evidence;
    this.evidence = { key, values: null };
    if (stored && row < stored.start.length - 1 && stored.start[row + 1]! > stored.start[row]!) {
      try {
        const values = await loadEvidence(source.id, number, row);
        if (this.evidence.key !== key) return;
        this.evidence = { key, values };
      } catch (error) {
        this.complain((error as Error).message);
      }
    }
    const detection = source.index.detections[number];
    if (this.evidence.key === key && detection && this.selected === row) this.panel.show(source, detection, row, this.a, this.evidence.values, this.colours);
  }

  // ---------------------------------------------------------------- notes

  private noteKey(row: number): string {
    const detection = this.detection!;
    return `${this.source.title}|${detection.name}|${detection.alarms.alarm_id?.[row] ?? row}`;
  }

  note(row: number): Note {
    return this.notes.get(this.noteKey(row));
  }

  setNote(change: Partial<Note>): void {
    if (this.selected === null) return;
    const note = this.notes.set(this.noteKey(this.selected), change);
    this.showList();
    if (change.verdict !== undefined) {
      checkRadio("verdict", note.verdict);
      this.say(`Verdict: ${note.verdict || "none"}`);
    }
  }

  async loadNotes(file: File): Promise<void> {
    try {
      const count = await this.notes.load(file);
      this.showAlarm();
      this.showList();
      this.say(`${count} notes loaded`);
    } catch {
      this.complain(`${file.name}: these are no notes saved by this page`);
    }
  }

  private tick(rows: number[], on: boolean): void {
    for (const row of rows) on ? this.ticked.add(row) : this.ticked.delete(row);
    this.showList();
  }

  // ---------------------------------------------------------------- drawing

  overlay(): Overlay {
    const second = this.compare === "off" ? null : secondOf(this.sources, this.a, this.b);
    const [, b] = this.operating();
    const level = b ? (b.curve.threshold[b.row] ?? Infinity) : -Infinity;
    return {
      source: this.source,
      detection: this.detection,
      threshold: this.threshold,
      visible: this.visible,
      inSubset: (target) => {
        const score = this.source.score!;
        return (this.kind === null || score.truth.kind[target] === this.kind) && (this.depth === null || score.target_depth[target] === this.depth);
      },
      selected: this.selected,
      second: second && { ...second, visible: (row) => second.detection.alarms.confidence[row]! >= level },
      live: this.live,
      show: this.show,
    };
  }

  private palette(): Palette {
    return { text: colour("soft"), axis: colour("line"), paper: colour("paper"), unseen: colour("unseen") };
  }

  resized(): void {
    const { width, height } = fitted(el<HTMLCanvasElement>("lane"));
    this.view.box = Picture.box(width, height);
    if (this.fitting) this.view.fit();
    else this.view.hold();
    this.redraw();
  }

  redraw(): void {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.draw();
      this.drawOverview();
    });
  }

  private rasters(context: CanvasRenderingContext2D, density: number): boolean {
    const { box } = this.view;
    const draw = (choice: Choice, clip: Box): boolean => this.picture.raster(context, choice, clip, this.smooth, density);
    if (this.compare === "swipe") {
      const at = this.view.turned ? box.height * this.divide : box.width * this.divide;
      const first = this.view.turned ? { ...box, height: at } : { ...box, width: at };
      const rest = this.view.turned ? { ...box, top: box.top + at, height: box.height - at } : { ...box, left: box.left + at, width: box.width - at };
      const [a, b] = [draw(this.a, first), draw(this.b, rest)];
      return a && b;
    }
    return draw(this.compare === "blink" && this.flipped ? this.b : this.a, box);
  }

  private draw(): void {
    const start = performance.now();
    const { context, width, height, density } = fitted(el<HTMLCanvasElement>("lane"));
    const palette = this.palette();
    const { box } = this.view;
    context.clearRect(0, 0, width, height);
    context.fillStyle = palette.unseen;
    context.fillRect(box.left, box.top, box.width, box.height);
    const whole = this.rasters(context, density);
    const pen = canvasPen(context);
    context.save();
    context.beginPath();
    context.rect(box.left, box.top, box.width, box.height);
    context.clip();
    drawOverlay(pen, this.view, this.overlay());
    this.drawComparison(pen);
    context.restore();
    this.picture.axes(pen, palette);
    if (this.source.index.layers.length) colourBar(pen, box, this.colours, palette, box.top + 166);
    this.showBadge();
    if (whole && !this.marked && box.width > 10) {
      this.marked = true;
      performance.mark("flgpr:first-picture");
    }
    performance.measure("flgpr:frame", { start, end: performance.now() });
  }

  private drawComparison(pen: Pen): void {
    const { box, turned } = this.view;
    if (this.compare === "off") return;
    const words = (choice: Choice, name: string): string => {
      const source = this.sources[choice.source]!;
      const result = this.sources.length > 1 ? `${source.title.split(" ")[0]}, ` : "";
      return `${name}: ${result}${setLabel(source, choice.set)}, ${choice.polarization} ${choice.subband}`;
    };
    const style = { fill: "#ffffff", halo: "#10151c", size: 12, bold: true };
    if (this.compare === "blink") {
      const [choice, name] = this.flipped ? [this.b, "B"] : [this.a, "A"];
      pen.text(box.left + 10, box.top + box.height - 10, words(choice, name), style);
      return;
    }
    const at = turned ? box.top + box.height * this.divide : box.left + box.width * this.divide;
    const line: [number, number][] = turned ? [[box.left, at], [box.left + box.width, at]] : [[at, box.top], [at, box.top + box.height]];
    pen.path(line, false, { stroke: "#10151c", width: 5 });
    pen.path(line, false, { stroke: "#ffe45c", width: 2 });
    if (turned) {
      pen.text(box.left + 10, at - 8, words(this.a, "A"), style);
      pen.text(box.left + 10, at + 18, words(this.b, "B"), style);
    } else {
      pen.text(at - 8, box.top + box.height - 10, words(this.a, "A"), { ...style, anchor: "end" });
      pen.text(at + 8, box.top + box.height - 10, words(this.b, "B"), style);
    }
  }

  private showBadge(): void {
    const ratio = this.view.scaleX / this.view.scale;
    el("badge").textContent = ratio > 1.05 ? `cross-track stretched × ${fixed(ratio, ratio < 10 ? 1 : 0)}` : "";
    el("zoom-true").setAttribute("aria-pressed", String(ratio <= 1.05));
  }

  private drawOverview(): void {
    const canvas = el<HTMLCanvasElement>("overview");
    const { context, width, height } = fitted(canvas);
    const box: Box = { left: this.view.box.left, top: 4, width: Math.max(width - this.view.box.left - 52, 10), height: height - 8 };
    context.clearRect(0, 0, width, height);
    context.fillStyle = colour("unseen");
    context.fillRect(box.left, box.top, box.width, box.height);
    this.picture.overview(context, this.compare === "blink" && this.flipped ? this.b : this.a, box);
    const { extent } = this.view;
    const scale = box.width / this.view.length;
    const rows = this.detection && this.show.alarms ? this.detection.alarms : null;
    rows?.y.forEach((y, row) => {
      if (!this.visible(row)) return;
      context.fillStyle = labelOf(this.source, this.detection, row) === "false" ? "#ffb84d" : "#7fd4ff";
      context.fillRect(box.left + (y - extent.y_min) * scale - 0.75, box.top + box.height - 5, 1.5, 5);
    });
    const [low, high] = this.view.span();
    const from = box.left + Math.max((low - extent.y_min) * scale, 0);
    const to = box.left + Math.min((high - extent.y_min) * scale, box.width);
    context.lineWidth = 2;
    context.strokeStyle = "#ffe45c";
    context.strokeRect(from + 1, box.top - 1, Math.max(to - from - 2, 3), box.height + 2);
  }

  overviewTo(px: number): void {
    const canvas = el<HTMLCanvasElement>("overview");
    const width = Math.max(canvas.clientWidth - this.view.box.left - 52, 10);
    this.view.y = this.view.extent.y_min + ((px - this.view.box.left) / width) * this.view.length;
    this.moved();
  }

  moved(): void {
    this.fitting = false;
    if (this.follow) this.setFollow(false);
    this.view.hold();
    this.redraw();
  }

  /** Zoom about the selected alarm if it is in sight, else about the middle. */
  zoom(factor: number): void {
    const { left, top, width, height } = this.view.box;
    let [px, py] = [left + width / 2, top + height / 2];
    if (this.selected !== null && this.detection) {
      const [sx, sy] = this.view.toScreen(this.detection.alarms.x[this.selected]!, this.detection.alarms.y[this.selected]!);
      if (sx > left && sx < left + width && sy > top && sy < top + height) [px, py] = [sx, sy];
    }
    this.view.zoom(factor, px, py);
    this.moved();
  }

  fit(): void {
    this.fitting = true;
    if (this.follow) this.setFollow(false);
    this.view.fit();
    this.redraw();
  }

  trueScale(): void {
    this.view.fill = !this.view.fill;
    this.moved();
  }

  turn(): void {
    this.view.turned = !this.view.turned;
    this.fit();
  }

  // ---------------------------------------------------------------- words

  point(px: number, py: number): void {
    const { box } = this.view;
    const tip = el("tip");
    if (px < box.left || px > box.left + box.width || py < box.top || py > box.top + box.height) {
      el("readout").textContent = "";
      tip.hidden = true;
      return;
    }
    const [x, y] = this.view.toLane(px, py);
    el("readout").textContent = this.readout(x, y);
    const hit = hitTest(this.view, this.overlay(), px, py);
    tip.hidden = !hit;
    if (hit) {
      tip.textContent = hit.words;
      const right = px > box.left + box.width * 0.7;
      tip.style.left = right ? "" : `${px + 14}px`;
      tip.style.right = right ? `${el("stage").clientWidth - px + 14}px` : "";
      tip.style.top = `${Math.min(py + 12, box.top + box.height - 44)}px`;
    }
  }

  private readout(x: number, y: number): string {
    const words = [`y ${fixed(y, 2)} m`, `x ${fixed(x, 2)} m`];
    const amplitude = (choice: Choice, name: string): void => {
      const source = this.sources[choice.source]!;
      const value = this.picture.value(choice, x, y, HALF);
      const median = layerOf(source, choice)?.percentiles["50"] ?? 0;
      if (Number.isFinite(value)) words.push(`${name}${fixed(value - median, 1)} dB above median${choice.set === "before" ? "" : ` (${fixed(value, 1)} re background)`}`);
    };
    amplitude(this.a, this.compare === "off" ? "" : "A ");
    if (this.compare !== "off") amplitude(this.b, "B ");
    const { scans } = this.source.index;
    let best = -1;
    scans.y.forEach((sy, i) => {
      if (!scans.masked.includes(i) && sy < y && (best < 0 || sy > scans.y[best]!)) best = i;
    });
    if (best >= 0) words.push(`scan ${best}, range ${fixed(Math.hypot(x - scans.x[best]!, y - scans.y[best]!), 1)} m`);
    const place = geographic(this.source.index.georeference);
    if (place) {
      const [latitude, longitude] = place(x, y);
      words.push(`${latitude.toFixed(6)}°, ${longitude.toFixed(6)}°`);
    }
    return words.join("   ");
  }

  click(px: number, py: number): void {
    const hit = hitTest(this.view, this.overlay(), px, py);
    if (hit?.kind === "alarm") this.select(hit.row);
  }

  say(words: string): void {
    el("said").textContent = words;
  }

  complain(words: string): void {
    el("message").textContent = words;
    el("message").hidden = false;
  }

  // ---------------------------------------------------------------- exports and theme

  exportRows(): number[] {
    const shown = this.shownRows();
    return this.ticked.size ? shown.filter((row) => this.ticked.has(row)) : shown;
  }

  private describePicture(): string {
    const { polarization, subband, set } = this.a;
    const { floor, range } = this.colours;
    return `${this.source.index.title}: ${setLabel(this.source, set)}, ${polarization} ${subband}; ${digits(floor)} to ${digits(floor + range)} dB above the median`;
  }

  exportPng(): void {
    savePng(this.parts(), this.view);
  }

  exportSvg(): void {
    saveSvg(this.parts(), this.view);
  }

  private parts(): FigureParts {
    return {
      title: this.describePicture(),
      palette: { ...this.palette(), text: colour("ink") },
      raster: (context, factor) => this.rasters(context, factor),
      over: (pen) => {
        drawOverlay(pen, this.view, this.overlay());
        this.drawComparison(pen);
      },
      around: (pen, palette) => {
        this.picture.axes(pen, palette);
        colourBar(pen, this.view.box, this.colours, palette, this.view.box.top);
      },
    };
  }

  exportTable(form: "csv" | "geojson"): void {
    if (!this.detection) return;
    const rows = alarmRows(this.source, this.detection, this.exportRows(), (row) => this.note(row));
    if (form === "csv") download("flgpr-alarms.csv", asCsv(rows), "text/csv");
    else download("flgpr-alarms.geojson", asGeoJson(rows, geographic(this.source.index.georeference)), "application/geo+json");
  }

  setTheme(theme: string): void {
    document.documentElement.dataset["theme"] = theme;
    this.scoresChanged();
    this.panel.redraw();
  }
}
