import { AlarmPanel } from "./alarm";
import type { Colours } from "./colour";
import { COLOUR_MAPS } from "./colormaps";
import { drawBackdrop, type Backdrop } from "./backdrop";
import { drawComparison, rasters } from "./compare";
import { detectionOf, EARLIER, loadEvidence, setLabel, Tiles } from "./data";
import { checkRadio, colour, digits, el, fitted, fixed, make, options } from "./dom";
import { Following } from "./following";
import { extentOf } from "./geo";
import { groupAlarms, type Group } from "./groups";
import { canvasPen, colourBar, Picture, type Palette } from "./lane";
import { AlarmList } from "./list";
import type { Live } from "./live";
import type { Notes } from "./notes";
import { drawOverlay, secondOf, showLegend, type Overlay } from "./overlay";
import { drawOverview } from "./overview";
import type { Page } from "./page";
import type { RawPanel } from "./raw";
import { drawRoad, type Scene } from "./road";
import { answerWords, curveOf, equalFalse, pointWords, RocPlot, showCounts, showScores, thresholdsOf, type Operating } from "./roc";
import { Scrub } from "./scrub";
import type { Choice, Compare, Detection, Note, Source } from "./types";
import { View } from "./view";
import { alarmFacts, alarmWords, sentences } from "./words";

/** What stands out: of the first detection alone. */
const standingOf = (source: Source, detection: Detection | undefined): Source["index"]["stands_out"] => (detection?.name === "main" ? source.index.stands_out : undefined);

export class App implements Page {
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
  /** The live run as it was after the scan that the page has gone back to. */
  past: Live | null = null;
  raw: RawPanel | null = null;
  backdrop: Backdrop | null = null;
  scan: number | null = null;
  readonly following: Following = new Following(this);
  readonly scrub: Scrub = new Scrub(this);
  readonly view: View;
  readonly picture: Picture;
  readonly tiles: Tiles;
  private readonly panel: AlarmPanel;
  private readonly list: AlarmList;
  private readonly roc: RocPlot;
  thresholds: (number | null)[] = [null];
  private waiting = 0;
  fitting = true;
  /** How much larger than at the desk the picture's lines and words are. */
  enlarged = 1;
  /** Whether the driver's screen is shown. */
  driving = false;
  /** What the driver's picture is made of. */
  scene: Scene | null = null;
  private marked = false;
  /** Whether the picture that is drawn groups alarms. */
  private grouped = false;
  /** Whether there are scores and no pictures. */
  private readonly scored: boolean;
  evidence: { key: string; values: Float32Array | null } = { key: "", values: null };
  private blinking: number | undefined;
  /** The set of picture A from before days were compared. */
  private shownSet = "";

  constructor(
    readonly sources: Source[],
    readonly notes: Notes,
  ) {
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
    this.scored = sources.every((one) => one.index.scored);
    document.body.classList.toggle("scored", this.scored);
    el("scores").hidden = !this.scored;
    if (this.scored && secondOf(sources, this.a, this.b)) this.compare = "swipe";
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

  private get standing(): Source["index"]["stands_out"] {
    return standingOf(this.source, this.detection);
  }

  // ---------------------------------------------------------------- choices

  choose(side: "a" | "b", change: Partial<Choice>): void {
    const before = this.detection;
    const choice = { ...this[side], ...change };
    const layers = this.sources[choice.source]!.index.layers.filter((one) => one.detection === choice.set);
    if (layers.length && !layers.some((one) => one.polarization === choice.polarization)) choice.polarization = layers[0]!.polarization;
    if (layers.length && !layers.some((one) => one.subband === choice.subband)) choice.subband = layers[0]!.subband;
    this[side] = choice;
    // Days are compared in one channel.
    if (side === "a" && this.betweenDays && change.set === undefined) this.b = { ...choice, set: EARLIER };
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
    this.blinking = undefined;
    if (compare === "blink" && !window.matchMedia("(prefers-reduced-motion: reduce)").matches)
      this.blinking = window.setInterval(() => this.flip(), 700);
    checkRadio("compare", compare);
    this.showChoices();
    this.scoresChanged();
    this.say(compare === "off" ? "Picture A only" : `Compare A with B: ${compare}`);
  }

  private get betweenDays(): boolean {
    return this.compare === "blink" && this.a.set === "before" && this.b.set === EARLIER && this.a.source === this.b.source;
  }

  /** Blink between today and the earlier drive; the next time, show again what was shown before. */
  days(): void {
    if (el("days").hidden) return;
    if (!this.betweenDays) {
      this.shownSet = this.a.set;
      this.choose("a", { set: "before" });
      this.choose("b", { ...this.a, set: EARLIER });
      this.setCompare("blink");
    } else if (this.blinking === undefined && !this.flipped) this.flip();
    else {
      this.setCompare("off");
      this.choose("a", { set: this.shownSet });
    }
  }

  flip(): void {
    this.flipped = !this.flipped;
    this.redraw();
  }

  showChoices(): void {
    for (const side of ["a", "b"] as const) {
      const choice = this[side];
      const sets = this.sources.flatMap((source) => {
        const { scored, detections, layers } = source.index;
        const names = scored ? detections.map((one) => one.name) : [...new Set(layers.map((one) => one.detection))];
        const group = this.sources.length > 1 ? source.title : undefined;
        return names.map((name) => ({ value: `${source.id}/${name}`, label: setLabel(source, name), ...(group && { group }) }));
      });
      options(el<HTMLSelectElement>(`${side}-set`), sets, `${choice.source}/${choice.set}`);
      const layers = this.sources[choice.source]!.index.layers.filter((one) => one.detection === choice.set);
      const unique = (values: string[]): { value: string; label: string }[] => [...new Set(values)].map((value) => ({ value, label: value }));
      options(el<HTMLSelectElement>(`${side}-pol`), unique(layers.map((one) => one.polarization)), choice.polarization);
      options(el<HTMLSelectElement>(`${side}-band`), unique(layers.map((one) => one.subband)), choice.subband);
      el(`${side}-pol`).hidden = el(`${side}-band`).hidden = !layers.length;
    }
    const layered = this.source.index.layers.length > 0;
    el("choice-a").hidden = !layered && !this.source.index.scored;
    el("display").hidden = !layered;
    el("choice-b").hidden = this.compare === "off";
    el("days").hidden = !this.source.index.layers.some((one) => one.detection === EARLIER);
    el("days").setAttribute("aria-pressed", String(this.betweenDays));
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
    drawOverview(this);
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

  detectionChanged(): void {
    const { unlike = [] } = this.source.index;
    const told = this.standing;
    el("unlike").textContent = sentences(unlike.slice(0, 1));
    this.thresholds = this.detection ? thresholdsOf(this.source, this.detection.name) : [null];
    const curve = this.detection && curveOf(this.source.score, this.detection.name, null, null);
    const border = curve ? null : (told?.border ?? this.detection?.border ?? null);
    const learnt = border === null ? -1 : this.thresholds.filter((one) => one === null || one >= border).length - 1;
    this.row = curve?.point?.row ?? (learnt < 0 ? this.thresholds.length - 1 : learnt);
    const point = curve ? pointWords(curve) : told ? sentences(told.notes.slice(1)) : border === null ? "" : `Opened where the detector decides for a mine by what it has learnt: confidence ${digits(border)}.`;
    el("point").textContent = [point, sentences(unlike.slice(1))].filter(Boolean).join(" ");
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
      this.live.wanted = null;
      this.live.least = this.source.title !== "live" || this.row >= this.thresholds.length - 1 ? -Infinity : (this.threshold ?? Infinity);
      (this.past ?? this.live).report();
    }
    this.following.moved();
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
    this.roc.show(a, b, this.source.score ? "No target of this subset." : "Not scored: flgpr score RESULT --truth TRUTH adds the ROC.");
    this.showThreshold();
    this.redraw();
    if (this.scored) performance.mark("flgpr:first-picture");
  }

  showThreshold(): void {
    const [a, b] = this.operating();
    const slider = el<HTMLInputElement>("threshold");
    slider.value = String(this.row);
    const untold = this.threshold === null && this.row > 0;
    const words = untold ? "not told" : this.threshold === null ? "none" : digits(this.threshold, 4);
    el("threshold-out").textContent = this.threshold === null && !untold ? "∞" : words;
    const shown = this.shownRows();
    el("threshold-left").textContent = this.source.index.scored && a
      ? `${a.curve.n_false[this.row]} of ${a.curve.n_false[a.curve.n_false.length - 1]} false alarms left`
      : `${shown.length} of ${this.detection?.alarms.x.length ?? 0} alarms left`;
    slider.setAttribute(
      "aria-valuetext",
      a ? `confidence ${words}: ${a.curve.n_detected[this.row]} of ${a.curve.n_targets} found, ${a.curve.n_false[this.row]} false alarms` : `confidence ${words}: ${shown.length} alarms`,
    );
    const second = secondOf(this.sources, this.a, this.b);
    const first = (standing: Source["index"]["stands_out"]): string => sentences(standing?.notes.slice(0, 1) ?? []);
    const [own, other] = [first(this.standing), second ? first(standingOf(second.source, second.detection)) : ""];
    el("answer").textContent = a ? answerWords(a, b) : other ? `A: ${own} B: ${other}` : own;
    const name = (source: Source, detection: Detection | undefined): string => (this.sources.length > 1 && source.title.split(" ")[0]) || (detection?.name ?? "");
    showCounts(el<HTMLTableElement>("counts"), a, b, shown.length, [name(this.source, this.detection), second ? name(second.source, second.detection) : ""]);
    if (this.scored) this.showScored(a, b, second);
    this.showList();
    showLegend(el("legend"), this.overlay());
  }

  private showScored(a: Operating | undefined, b: Operating | undefined, second: ReturnType<typeof secondOf>): void {
    const side = (source: Source, detection: Detection, at: Operating) => ({ scored: source.score!.detections[detection.name]!, at });
    showScores(el("scores"), [...(a ? [side(this.source, this.detection!, a)] : []), ...(b && second ? [side(second.source, second.detection, b)] : [])]);
    const [mine, other] = [this.source.score?.rules ?? {}, second?.source.score?.rules ?? this.source.score?.rules ?? {}];
    const unlike = [...new Set([...Object.keys(mine), ...Object.keys(other)])].filter((name) => mine[name] !== other[name]);
    const told = unlike.map((name) => (name === "truth" ? "another truth" : `${name.replaceAll("_", " ")} ${String(mine[name] ?? "not told")} and ${String(other[name] ?? "not told")}`));
    if (told.length) el("scores").prepend(make("p", { class: "missed", role: "alert" }, `A and B do not compare: ${told.join("; ")}.`));
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
      if (this.following.on && this.view.y !== before) this.following.set(false);
    }
    this.showAlarm();
    this.showList();
    this.redraw();
    if (row !== null) this.say(alarmWords(this.source, this.detection!, row));
  }

  step(by: number): void {
    const rows = this.shownRows();
    if (!rows.length) return this.say("No alarm at this threshold");
    const at = this.selected === null ? -1 : rows.indexOf(this.selected);
    const next = at < 0 ? (by > 0 ? 0 : rows.length - 1) : (at + by + rows.length) % rows.length;
    this.select(rows[next]!, true);
  }

  showAlarm(): void {
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
    el("alarm-title").textContent = alarms.alarm_id?.[row] ?? `alarm-${row + 1}`;
    el("alarm-facts").textContent = alarmFacts(this.source, detection, row);
    el("alarm-facts").title = alarmWords(this.source, detection, row);
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

  note(row: number): Note {
    return this.notes.get(this.source, this.detection!, row);
  }

  setNote(change: Partial<Note>): void {
    if (this.selected === null) return;
    const note = this.notes.set(this.source, this.detection!, this.selected, change);
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
      this.say(`${count} notes loaded on alarms of what is open`);
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
      live: this.past ?? this.live,
      scan: this.scan,
      gaps: this.picture.gaps,
      groups: this.groups(),
      show: this.show,
    };
  }

  /** Alarms by cells of the picture where there is no room for each. */
  private groups(): Group[] | null {
    const { detection } = this;
    if (!detection || this.driving || !this.show.alarms) return null;
    return groupAlarms(this.view, detection, this.visible);
  }

  palette(): Palette {
    return { text: colour("soft"), axis: colour("line"), paper: colour("paper"), unseen: colour("unseen") };
  }

  resized(): void {
    const { width, height } = fitted(el<HTMLCanvasElement>("lane"), this.enlarged);
    this.view.box = this.driving ? { left: 0, top: 0, width, height } : Picture.box(width, height);
    if (this.fitting) this.view.fit();
    else if (this.following.on) this.following.set(true);
    else this.view.hold();
    this.redraw();
  }

  redraw(): void {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.draw();
      drawOverview(this);
    });
  }

  private draw(): void {
    const start = performance.now();
    const { context, width, height, density } = fitted(el<HTMLCanvasElement>("lane"), this.enlarged);
    const palette = this.palette();
    const { box } = this.view;
    context.clearRect(0, 0, width, height);
    context.fillStyle = palette.unseen;
    context.fillRect(box.left, box.top, box.width, box.height);
    if (this.driving) {
      this.drawDriven(context, density, start);
      return;
    }
    drawBackdrop(context, this.view, this.backdrop);
    const gaps = this.picture.gaps;
    const whole = rasters(this, context, density);
    const overlay = this.overlay();
    const grouped = overlay.groups !== null;
    if (this.picture.gaps !== gaps || this.grouped !== grouped) showLegend(el("legend"), overlay);
    this.grouped = grouped;
    const pen = canvasPen(context);
    context.save();
    context.beginPath();
    context.rect(box.left, box.top, box.width, box.height);
    context.clip();
    drawOverlay(pen, this.view, overlay);
    drawComparison(this, pen);
    context.restore();
    this.picture.axes(pen, palette);
    if (this.source.index.layers.length) colourBar(pen, box, this.colours, palette, box.top + el("zoom").offsetHeight + 14);
    this.showBadge();
    if (whole && !this.marked && box.width > 10) {
      this.marked = true;
      performance.mark("flgpr:first-picture");
    }
    performance.measure("flgpr:frame", { start, end: performance.now() });
  }

  /** The driver's picture: the road as of the page's last look, in place of the lane. */
  private drawDriven(context: CanvasRenderingContext2D, density: number, start: number): void {
    const { box } = this.view;
    context.fillStyle = colour("road");
    context.fillRect(box.left, box.top, box.width, box.height);
    if (this.scene) drawRoad(this, context, canvasPen(context), density, this.scene);
    if (!this.marked && box.width > 10) {
      this.marked = true;
      performance.mark("flgpr:first-picture");
    }
    performance.measure("flgpr:frame", { start, end: performance.now() });
  }

  private showBadge(): void {
    const ratio = this.view.scaleX / this.view.scale;
    const stretched = ratio > 1.05 ? `cross-track stretched × ${fixed(ratio, ratio < 10 ? 1 : 0)}` : "";
    const grouped = this.grouped ? "alarms grouped until zoomed" : "";
    el("badge").textContent = [stretched, grouped].filter(Boolean).join("; ");
    el("zoom-true").setAttribute("aria-pressed", String(ratio <= 1.05));
  }

  moved(): void {
    this.fitting = false;
    if (this.following.on) this.following.set(false);
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
    if (this.following.on) this.following.set(false);
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

  /** Mark a scan on the track. */
  markScan(scan: number | null): void {
    this.scan = scan;
    this.scrub.refresh();
    this.redraw();
    if (scan !== null) this.say(`scan ${scan}`);
  }

  say(words: string): void {
    el("said").textContent = words;
  }

  complain(words: string): void {
    el("message").textContent = words;
    el("message").hidden = false;
  }

  // ---------------------------------------------------------------- exports and theme

  /** Alarms that are saved: those ticked in the list, or all that are shown. */
  exportRows(): number[] {
    const shown = this.shownRows();
    return this.ticked.size ? shown.filter((row) => this.ticked.has(row)) : shown;
  }

  setTheme(theme: string): void {
    document.documentElement.dataset["theme"] = theme;
    this.scoresChanged();
    this.panel.redraw();
    this.raw?.redraw();
    this.raw?.curves();
  }
}
