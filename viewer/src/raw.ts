import uPlot from "uplot";
import { COLOUR_MAPS } from "./colormaps";
import { colourAt, colourTable } from "./colour";
import { getJson, HALF } from "./data";
import { colour, digits, el, fitted, fixed, make, options } from "./dom";
import { format } from "./lane";
import { halves } from "./live";
import { CanvasPen } from "./pen";
import type { Source } from "./types";
import { ticks, type Box } from "./view";
import { sentences, wrapped } from "./words";

const METRES = 0.149896229; // of range per nanosecond, there and back in air
const STEP_OF_FIT = 1.02; // of permittivity by arrows up and down
const MAP = { db: "viridis", signed: "grey" };

interface Bscan {
  scans: number[];
  delays_ns: { start: number; stop: number; count: number };
  scale: "db" | "signed";
  unit: number;
  top_db: number | null;
  missing: number[];
  incomplete: number[];
  ends: { delay_ns: number; words: string }[]; // where simulated echoes end
  halves: string;
  toml: string;
}
type Axis = [name: string, first: number, last: number, count: number];
interface Focus {
  across: Axis;
  up: Axis;
  fixed: Record<string, number>;
  scans: number;
  top_db: number;
  halves: string;
  peaks: Record<string, number>[];
}
interface Spectrum { frequency_ghz: number[]; level_db: (number | null)[]; median_db: (number | null)[]; disturbed_ghz: number[] }
interface Health { summary: string[]; every: number; channels: Record<string, (number | string | boolean | null)[]> }

/** The raw data of a run, as the server has worked it out: B-scan, A-scan, spectrum, images, health. */
export class RawPanel {
  private shown: Bscan | null = null;
  private focus: Focus | null = null;
  private asked = 0;
  private apex: number | null = null; // ns
  private settings = "";
  private values: Uint16Array = new Uint16Array(0);
  private image: HTMLCanvasElement | null = null;
  private spectrum: Spectrum | null = null;
  private plots: uPlot[] = [];
  private busy = false;
  private again = false;
  private over: number | null = null;
  column: number | null = null;
  private readonly canvas = el<HTMLCanvasElement>("bscan");

  constructor(
    private readonly source: Source,
    private readonly marked: (scan: number | null) => void,
  ) {
    el("raw").hidden = el("raw-side").hidden = false;
    const run = source.index.run!;
    const same = (value: string): { value: string; label: string } => ({ value, label: value });
    options(el<HTMLSelectElement>("raw-pol"), run.polarizations.map(same), run.polarizations[0]!);
    options(el<HTMLSelectElement>("raw-pair"), Array.from({ length: run.pairs }, (_, i) => same(String(i))), "0");
    el("raw-map").append(...Object.keys(COLOUR_MAPS).map((name) => make("option", {}, name)));
    const { scans } = source.index;
    el("raw-facts").textContent = `${scans.y.length} scans, ${run.pairs} pair${run.pairs === 1 ? "" : "s"}, ${run.polarizations.join(" ")}, ${run.tones} tones from ${digits(run.frequency_hz[0] / 1e9)} to ${digits(run.frequency_hz[1] / 1e9)} GHz`;
    if (run.recording) el<HTMLSelectElement>("raw-scale").value = "signed";
    el("raw-notes").replaceChildren(...run.notes.map((words) => make("li", {}, words)));
    el("raw-notes-head").hidden = !run.notes.length;
    el("raw").querySelectorAll("select, input").forEach((field) =>
      field.addEventListener("change", () => (["raw-range", "raw-map"].includes(field.id) ? this.painted() : void this.ask())),
    );
    el("raw-range").addEventListener("input", () => this.painted());
    el("raw-view").addEventListener("change", () => {
      el<HTMLInputElement>("raw-range").value = this.view() === "bscan" ? "60" : "40";
    });
    el("raw-copy").addEventListener("click", () => void this.copy());
    this.canvas.addEventListener("pointermove", (event) => this.hover(this.columnAt(event)));
    this.canvas.addEventListener("pointerleave", () => this.hover(null));
    this.canvas.addEventListener("click", (event) => {
      if (this.focus) return;
      const { top, height } = this.box();
      const delay = this.shown ? this.delayAt((event.offsetY - top) / height) : null;
      this.apex = delay !== null && delay > 0 ? delay : null;
      this.mark(this.columnAt(event));
    });
    el("raw-permittivity").addEventListener("input", () => this.redraw());
    el("raw-permittivity").addEventListener("keydown", (event) => {
      const way = event.key === "ArrowUp" ? 1 : event.key === "ArrowDown" ? -1 : 0;
      const field = el<HTMLInputElement>("raw-permittivity");
      if (!way) return;
      event.preventDefault();
      field.value = String(Math.max(Number(field.value || "1") * STEP_OF_FIT ** way, 1).toPrecision(3));
      this.redraw();
    });
    this.canvas.addEventListener("keydown", (event) => {
      const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
      if (!step || !this.shown) return;
      event.preventDefault();
      event.stopPropagation();
      this.mark(Math.min(Math.max((this.column ?? -step) + step, 0), this.shown.scans.length - 1));
    });
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    void this.ask().then(() => this.health());
  }

  /** Mark the scan that is shown nearest to one of the run. */
  markScan(scan: number): void {
    const scans = this.shown?.scans ?? [];
    let best = 0;
    scans.forEach((one, i) => (best = Math.abs(one - scan) < Math.abs(scans[best]! - scan) ? i : best));
    if (scans.length) this.mark(best);
  }

  private mark(column: number | null): void {
    this.column = column;
    this.marked(column === null ? null : this.shown!.scans[column]!);
    void this.cut();
    this.redraw();
    if (this.view() === "scan") void this.see();
  }

  private view(): string {
    return el<HTMLSelectElement>("raw-view").value;
  }

  /** Ask for the image of the marked scan, or of all, if one is wanted; of several answers the last counts. */
  private async see(): Promise<void> {
    const mine = ++this.asked;
    const view = this.view();
    let found: Focus | null = null;
    if (view !== "bscan" && this.shown) {
      const slow = el<HTMLInputElement>("raw-permittivity").value.trim();
      const more = new URLSearchParams({ scan: String(this.shown.scans[this.column ?? 0]!), whole: String(view === "whole"), ...(slow && { permittivity: slow }) });
      this.canvas.setAttribute("aria-busy", "true");
      try {
        found = await getJson<Focus>(`data/0/raw/image?${this.settings}&${more}`);
        if (mine === this.asked) el("raw-error").textContent = "";
      } catch (error) {
        if (mine === this.asked) el("raw-error").textContent = (error as Error).message;
      }
    }
    if (mine !== this.asked) return;
    const changed = found !== this.focus;
    this.focus = found;
    if (changed) this.painted();
    this.canvas.setAttribute("aria-busy", "false");
  }

  private hover(column: number | null): void {
    if (this.over === column) return;
    this.over = column;
    void this.cut();
  }

  /** The steps that are filled in, in the order in which they are taken. */
  private steps(): Record<string, unknown>[] {
    const number = (id: string): number | null => {
      const { value } = el<HTMLInputElement>(id);
      return value.trim() === "" ? null : Number(value);
    };
    const [zero, wow, scans, low, high, gate, power, agc] = ["zero", "dewow", "scans", "low", "high", "gate", "power", "agc"].map((name) => number(`step-${name}`));
    const found: Record<string, unknown>[] = [];
    if (zero != null) found.push({ do: "time-zero", delay_ns: zero });
    if (wow != null) found.push({ do: "dewow", length_ns: wow });
    if (el<HTMLInputElement>("step-background").checked) found.push({ do: "background", ...(scans != null && { scans }) });
    const [first, last] = this.source.index.run!.frequency_hz;
    if (low != null || high != null) found.push({ do: "band", low_ghz: low ?? first / 1e9, high_ghz: high ?? last / 1e9 });
    if (gate != null) found.push({ do: "gate", start_ns: gate });
    if (power != null) found.push({ do: "power", exponent: power });
    if (agc != null) found.push({ do: "agc", window_ns: agc });
    return found;
  }

  private query(): string {
    const value = (id: string): string => el<HTMLInputElement>(id).value;
    return String(new URLSearchParams({ polarization: value("raw-pol"), pair: value("raw-pair"), steps: JSON.stringify(this.steps()) }));
  }

  /** Ask for the B-scan of what is chosen; of changes meanwhile only the last is asked for. */
  private async ask(): Promise<void> {
    if (this.busy) {
      this.again = true;
      return;
    }
    this.busy = true;
    this.canvas.setAttribute("aria-busy", "true");
    const [to, query] = [el<HTMLInputElement>("raw-to").value.trim(), this.query()];
    let made = false;
    const more = new URLSearchParams({ scale: el<HTMLInputElement>("raw-scale").value, ...(to && { to_ns: to }) });
    try {
      const answer = await getJson<Bscan>(`data/0/raw/bscan?${query}&${more}`);
      this.shown = answer;
      this.settings = query;
      this.values = halves(answer.halves);
      this.spectrum = null;
      this.cutOf = "";
      el("raw-toml").textContent = answer.toml || "none: as recorded";
      el<HTMLButtonElement>("raw-copy").disabled = !answer.toml;
      el("raw-error").textContent = "";
      if (this.column !== null && this.column >= answer.scans.length) this.column = null;
      made = true;
    } catch (error) {
      el("raw-error").textContent = (error as Error).message;
    }
    this.busy = false;
    if (this.again) {
      this.again = false;
      return this.ask();
    }
    this.painted();
    this.canvas.setAttribute("aria-busy", "false");
    await Promise.all([made && this.see(), this.cut()]);
  }

  private async copy(): Promise<void> {
    const pre = el("raw-toml");
    try {
      await navigator.clipboard.writeText(this.shown?.toml ?? "");
      el("said").textContent = el("raw-copied").textContent = "copied";
    } catch {
      getSelection()?.selectAllChildren(pre);
      el("said").textContent = el("raw-copied").textContent = "selected: copy by hand";
    }
  }

  private map(): string {
    return el<HTMLSelectElement>("raw-map").value || (this.focus ? "magma" : MAP[this.shown?.scale ?? "db"]);
  }

  private range(): [low: number, span: number] {
    const span = Number(el<HTMLInputElement>("raw-range").value);
    if (this.focus) return [this.focus.top_db - span, span];
    return this.shown?.scale === "signed" ? [-40 / span, 80 / span] : [(this.shown?.top_db ?? 0) - span, span];
  }

  /** Colour the picture by look-up. */
  private painted(): void {
    el("raw-range-out").textContent = this.shown?.scale === "signed" && !this.focus ? `× ${fixed(Number(el<HTMLInputElement>("raw-range").value) / 40, 1)}` : `${el<HTMLInputElement>("raw-range").value} dB`;
    if (!this.shown) return;
    const { scans, delays_ns } = this.shown;
    const [low, span] = this.range();
    this.image = document.createElement("canvas");
    if (this.focus) return this.paintFocus(this.focus, colourTable({ map: this.map(), floor: low, range: span }, 0));
    const table = colourTable({ map: this.map(), floor: low, range: span }, 0);
    [this.image.width, this.image.height] = [scans.length, delays_ns.count];
    const context = this.image.getContext("2d")!;
    const data = context.createImageData(scans.length, delays_ns.count);
    const pixels = new Uint32Array(data.data.buffer);
    for (let i = 0; i < scans.length; i++) for (let k = 0; k < delays_ns.count; k++) pixels[k * scans.length + i] = table[this.values[i * delays_ns.count + k]!]!;
    context.putImageData(data, 0, 0);
    this.redraw();
  }

  private paintFocus({ across, up, halves: text }: Focus, table: Uint32Array): void {
    const [wide, high, values] = [across[3], up[3], halves(text)];
    [this.image!.width, this.image!.height] = [wide, high];
    const context = this.image!.getContext("2d")!;
    const data = context.createImageData(wide, high);
    const pixels = new Uint32Array(data.data.buffer);
    for (let i = 0; i < high; i++) for (let k = 0; k < wide; k++) pixels[(high - 1 - i) * wide + k] = table[values[i * wide + k]!]!;
    context.putImageData(data, 0, 0);
    this.redraw();
  }

  /** Draw the image in its true shape, stretched where it is much longer than wide, with its brightest points. */
  private drawFocus(context: CanvasRenderingContext2D, whole: Box, { across, up, fixed: at, scans, peaks }: Focus): void {
    const reach = ([, first, last, count]: Axis): [number, number] => [first - (last - first) / (count - 1) / 2, last + (last - first) / (count - 1) / 2];
    const [[x0, x1], [y0, y1]] = [reach(across), reach(up)];
    const scale = Math.min(whole.width / (x1 - x0), whole.height / (y1 - y0));
    const box = { ...whole, width: Math.max((x1 - x0) * scale, whole.width / 3), height: Math.max((y1 - y0) * scale, whole.height / 3) };
    const stretched = Math.abs(((box.width / box.height) * (y1 - y0)) / (x1 - x0) - 1) > 0.01;
    context.imageSmoothingEnabled = false;
    context.drawImage(this.image!, box.left, box.top, box.width, box.height);
    const pen = new CanvasPen(context);
    const text = { fill: colour("soft"), size: 10.5 };
    const [px, py] = [(x: number): number => box.left + ((x - x0) / (x1 - x0)) * box.width, (y: number): number => box.top + ((y1 - y) / (y1 - y0)) * box.height];
    for (const value of ticks(x0, x1, box.width / 60)) pen.text(px(value), box.top + box.height + 14, format(value), { ...text, anchor: "middle" });
    for (const value of ticks(y0, y1, box.height / 40)) pen.text(box.left - 6, py(value) + 4, format(value), { ...text, anchor: "end" });
    const still = Object.entries(at).map(([name, value]) => `${name} = ${format(value)} m`).join(", ");
    pen.text(box.left, box.top + box.height + 28, `${across[0]} to the right, ${up[0]} upwards, m; ${still}; ${scans} ${scans === 1 ? "scan" : "scans"}${stretched ? "; stretched" : ""}`, text);
    peaks.forEach((peak, i) => {
      const [x, y] = [px(peak[across[0]]!), py(peak[up[0]]!)];
      pen.ellipse(x, y, 6, 6, { stroke: "#ffffff", width: 1.3 });
      pen.text(x + 8, y - 5, String(i + 1), { fill: "#ffffff", size: 11 });
    });
    const list = [`brightest, dB below`, ...peaks.map((peak, i) => `${i + 1}  (${fixed(peak[across[0]]!, 2)}, ${fixed(peak[up[0]]!, 2)}) m  ${fixed(peak["level"]!, 1)}`)];
    if (box.left + box.width + 190 < whole.left + whole.width) list.forEach((words, i) => pen.text(box.left + box.width + 14, box.top + 14 + 16 * i, words, text));
  }

  /** Echo of a point below the marked place whose echo is there, in ground of the given permittivity: both antennas at one place on it. */
  private drawHyperbola(pen: CanvasPen, { left, top, width, height }: Box): void {
    const slow = Number(el<HTMLInputElement>("raw-permittivity").value);
    if (!(slow >= 1) || this.apex === null || this.column === null || !this.shown) return;
    const { scans } = this.shown;
    const [places, here, speed] = [this.source.index.scans, scans[this.column]!, (2 * METRES) / Math.sqrt(slow)];
    const points = scans.map((scan, i): [number, number] => {
      const away = Math.hypot(places.x[scan]! - places.x[here]!, places.y[scan]! - places.y[here]!);
      return [left + ((i + 0.5) / scans.length) * width, top + this.shareOf(Math.hypot(this.apex!, (2 * away) / speed)) * height];
    });
    pen.path(points.filter(([, y]) => y <= top + height), false, { stroke: "#ffffff", width: 1.6, dash: [6, 4] });
    const words = `permittivity ${format(slow)}, ${fixed(speed, 3)} m/ns, depth ${fixed((this.apex * speed) / 2, 2)} m`;
    pen.text(left + width / 2, top + 16, words, { fill: "#ffffff", size: 12, anchor: "middle", halo: "#000000" });
  }

  /** Lines at the delays where a simulation's echoes end, which those of a real radar do not. */
  private drawEnds(pen: CanvasPen, { left, top, width, height }: Box): void {
    this.shown!.ends.forEach(({ delay_ns, words }, i, { length }) => {
      const y = top + this.shareOf(delay_ns) * height;
      pen.path([[left, y], [left + width, y]], false, { stroke: "#ffffff", width: 1.2, dash: [2, 4] });
      const above = i < length - 1 || y > top + height - 16; // two ends lie close together
      const lines = wrapped(`${fixed(delay_ns, 1)} ns: ${words}`, (width - 12) / 6);
      lines.forEach((line, k) => pen.text(left + 6, above ? y - 4 - 13 * (lines.length - 1 - k) : y + 13 * (k + 1), line, { fill: "#ffffff", size: 11, halo: "#000000" }));
    });
  }

  private drawBar(context: CanvasRenderingContext2D, { left, top, width, height }: Box, words: string): void {
    const [pen, text] = [new CanvasPen(context), { fill: colour("soft"), size: 10.5 }];
    const [low, span] = this.range();
    const bar = left + width + 48;
    for (let i = 0; i < 64; i++) {
      const y = top + height * (1 - (i + 1) / 64);
      pen.path([[bar, y], [bar + 10, y], [bar + 10, y + height / 64 + 0.6], [bar, y + height / 64 + 0.6]], true, { fill: `rgb(${colourAt(this.map(), i / 63).join(",")})` });
    }
    for (const value of ticks(low, low + span, height / 40)) pen.text(bar + 13, top + height * (1 - (value - low) / span) + 4, format(value), text);
    pen.text(bar, top + height + 14, words, text);
  }

  private box(): Box {
    return { left: 46, top: 14, width: Math.max(this.canvas.clientWidth - 46 - 104, 10), height: Math.max(this.canvas.clientHeight - 14 - 34, 10) };
  }

  /** Delay, ns, at a share of the picture's height from above. */
  private delayAt(share: number): number {
    const { start, stop } = this.shown!.delays_ns;
    return start + share * (stop - start);
  }

  /** Share of the picture's height from above at a delay, ns. */
  private shareOf(delay: number): number {
    const { start, stop } = this.shown!.delays_ns;
    return (delay - start) / (stop - start);
  }

  private columnAt(event: MouseEvent): number | null {
    if (!this.shown || this.focus) return null;
    const { left, width } = this.box();
    const column = Math.floor(((event.offsetX - left) / width) * this.shown.scans.length);
    return column < 0 || column >= this.shown.scans.length ? null : column;
  }

  redraw(): void {
    const { context, width, height } = fitted(this.canvas);
    context.clearRect(0, 0, width, height);
    if (!this.shown || !this.image) return;
    const { scans, delays_ns, scale, missing, incomplete } = this.shown;
    const box = this.box();
    if (this.focus) {
      this.drawFocus(context, box, this.focus);
      return this.drawBar(context, box, "dB");
    }
    const { left, top } = box;
    const [right, bottom] = [left + box.width, top + box.height];
    context.fillStyle = colour("unseen");
    context.fillRect(left, top, box.width, box.height);
    context.imageSmoothingEnabled = scans.length > box.width;
    context.drawImage(this.image, left, top, box.width, box.height);
    const wide = box.width / scans.length;
    for (const [columns, name] of [[incomplete, "false"], [missing, "missed"]] as const) {
      context.fillStyle = colour(name);
      for (const i of columns) context.fillRect(left + i * wide, top - 7, Math.max(wide, 1.5), 5);
    }
    if (this.column !== null) {
      context.strokeStyle = "#ffe45c";
      context.lineWidth = 2;
      context.strokeRect(left + this.column * wide, top, Math.max(wide, 1), box.height);
    }
    const pen = new CanvasPen(context);
    this.drawEnds(pen, box);
    this.drawHyperbola(pen, box);
    const text = { fill: colour("soft"), size: 10.5 };
    const line = (a: [number, number], b: [number, number]): void => pen.path([a, b], false, { stroke: colour("soft"), width: 1 });
    for (const value of ticks(delays_ns.start, delays_ns.stop, box.height / 40)) {
      const y = top + this.shareOf(value) * box.height;
      line([left - 4, y], [left, y]);
      pen.text(left - 6, y + 4, format(value), { ...text, anchor: "end" });
    }
    for (const value of ticks(delays_ns.start * METRES, delays_ns.stop * METRES, box.height / 40)) {
      const y = top + this.shareOf(value / METRES) * box.height;
      line([right, y], [right + 4, y]);
      pen.text(right + 6, y + 4, format(value), text);
    }
    for (const i of ticks(0, Math.max(scans.length - 1, 1), box.width / 60).filter((one) => one in scans)) pen.text(left + (i + 0.5) * wide, bottom + 14, String(scans[i]), { ...text, anchor: "middle" });
    pen.text(left + box.width / 2, bottom + 28, "scan", { ...text, anchor: "middle" });
    pen.text(2, bottom + 28, "delay, ns", text);
    pen.text(right + 6, bottom + 28, "range, m", text);
    this.drawBar(context, box, scale === "db" ? "dB" : "signed");
  }

  private cutOf = "";
  private asking = false;

  /** A-scan and spectrum of the scan under the cursor, else of the marked one, else of the first. */
  private async cut(): Promise<void> {
    if (!this.shown) return;
    const column = this.over ?? this.column ?? 0;
    this.curves(column);
    const scan = this.shown.scans[column]!;
    const key = `${this.settings}&scan=${scan}`;
    if (this.asking || this.busy || key === this.cutOf) return;
    this.asking = true;
    try {
      this.spectrum = await getJson<Spectrum>(`data/0/raw/spectrum?${key}`);
    } catch (error) {
      this.spectrum = null;
      el("raw-error").textContent = (error as Error).message;
    }
    this.cutOf = key;
    this.asking = false;
    void this.cut();
  }

  curves(column = this.over ?? this.column ?? 0): void {
    this.plots.forEach((plot) => plot.destroy());
    this.plots = [];
    if (!this.shown) return;
    const { delays_ns, scale, scans } = this.shown;
    el("raw-scan").textContent = `scan ${scans[column]}`;
    const delays = Array.from({ length: delays_ns.count }, (_, k) => this.delayAt((k + 0.5) / delays_ns.count));
    const trace = delays.map((_, k) => {
      const value = HALF[this.values[column * delays_ns.count + k]!]!;
      return Number.isFinite(value) ? value : null;
    });
    const top = this.shown.top_db ?? 0;
    this.plot("ascan", "two-way delay, ns", scale === "db" ? "dB" : "amplitude / unit", [delays, trace], scale === "db" ? [top - 80, top + 6] : null);
    if (!this.spectrum) return;
    const { frequency_ghz: tones, level_db: level, median_db: median, disturbed_ghz: disturbed } = this.spectrum;
    const hit = new Set(disturbed);
    el("raw-disturbed").textContent = hit.size ? `; ${hit.size} ${hit.size === 1 ? "tone" : "tones"} disturbed` : "";
    this.plot("spectrum", "frequency, GHz", "dB", [tones, level, median, tones.map((tone, i) => (hit.has(tone) ? level[i]! : null))], null);
  }

  private plot(id: string, x: string, y: string, data: (number | null)[][], range: [number, number] | null): void {
    const home = el(id);
    const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), size: 4 }, font: "11px system-ui", labelFont: "11px system-ui" };
    const line = { width: 1.5, points: { show: false } };
    this.plots.push(
      new uPlot(
        {
          width: Math.max(home.clientWidth, 120),
          height: 150,
          legend: { show: false },
          cursor: { show: false },
          scales: { x: { time: false }, y: range ? { range } : {} },
          hooks: { draw: [(plot) => id === "ascan" && this.markEnds(plot)] },
          axes: [{ ...axis, label: x, labelSize: 14, size: 26 }, { ...axis, label: y, labelSize: 14, size: 44 }],
          series: [{}, { ...line, stroke: colour("accent") }, { ...line, stroke: colour("false"), dash: [5, 4] }, { paths: () => null, points: { show: true, size: 6, stroke: colour("missed"), fill: colour("missed") } }].slice(0, data.length),
        },
        data as uPlot.AlignedData,
        home,
      ),
    );
  }

  /** Dotted lines in the A-scan at the delays where simulated echoes end. */
  private markEnds({ ctx, bbox, valToPos }: uPlot): void {
    ctx.save();
    ctx.strokeStyle = colour("soft");
    ctx.setLineDash([2, 4]);
    for (const { delay_ns } of this.shown?.ends ?? []) {
      const x = valToPos(delay_ns, "x", true);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }

  private async health(): Promise<void> {
    try {
      const { summary, every, channels } = await getJson<Health>("data/0/raw/health");
      const more = every > 1 ? [`Levels and drifts are of every ${every}th scan.`] : [];
      const others = summary.length - 1;
      const beside = others ? ` What else was found stands under Channels: ${others}.` : "";
      el("answer").textContent = sentences(summary.slice(0, 1)) + beside;
      el("health-words").replaceChildren(...[...summary, ...more].map((words) => make("li", {}, words)));
      const column = (name: string, i: number, count: number): string => {
        const value = channels[name]![i] as number | null;
        return value === null ? "–" : fixed(Math.abs(value) < 0.5 * 10 ** -count ? 0 : value, count);
      };
      el("health-rows").replaceChildren(
        ...channels["pair"]!.map((pair, i) => {
          const cells = [`${channels["polarization"]![i]} ${pair}`, column("level_db", i, 1), String(channels["missing"]![i]), column("coherence", i, 2), column("gain_drift_db", i, 1), column("phase_drift_rad", i, 2)];
          return make("tr", channels["dead"]![i] ? { class: "dead" } : {}, ...cells.map((cell) => make("td", {}, cell)));
        }),
      );
    } catch (error) {
      el("health-words").replaceChildren(make("li", {}, (error as Error).message));
    }
  }
}
