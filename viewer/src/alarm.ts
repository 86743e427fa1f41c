import uPlot from "uplot";
import { colourTable, type Colours } from "./colour";
import { HALF } from "./data";
import { colour, digits, el, fixed, make, svg } from "./dom";
import type { Choice, Columns, Detection, Evidence, Source, Training } from "./types";

const LINES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const MOST_FEATURES = 12;
const FLOAT_TO_HALF_STEPS = 65536;

/** Half float nearest to a number, by bisection over the positive or negative halves. */
function nearestHalf(value: number): number {
  if (value !== value) return 0x7e00;
  const sign = value < 0 ? 0x8000 : 0;
  let low = 0;
  let high = 0x7bff;
  const size = Math.abs(value);
  while (low < high) {
    const middle = (low + high) >> 1;
    if (HALF[middle]! < size) low = middle + 1;
    else high = middle;
  }
  return (sign | low) % FLOAT_TO_HALF_STEPS;
}

interface Parts { patch: (p: number, s: number) => Float32Array; cut: (p: number, s: number) => Float32Array; trace: (p: number) => Float32Array }

function partsOf(evidence: Evidence, values: Float32Array, scan: number, scans: number): Parts {
  const { polarization, subband, patch, cut, trace } = evidence;
  const [np, ns, area] = [polarization.length, subband.length, patch.size * patch.size];
  const block = values.length / scans;
  const at = scan * block;
  return {
    patch: (p, s) => values.subarray(at + (p * ns + s) * area, at + (p * ns + s + 1) * area),
    cut: (p, s) => values.subarray(at + np * ns * area + (p * ns + s) * cut.length, at + np * ns * area + (p * ns + s + 1) * cut.length),
    trace: (p) => {
      const start = at + np * ns * (area + cut.length) + p * trace.length;
      return values.subarray(start, start + trace.length);
    },
  };
}

const isFalse = (one: Training): boolean => /false|clutter|^0$/i.test(one.label);

export class AlarmPanel {
  private plots: uPlot[] = [];
  private tab = 0;
  private readonly figures = ["cut-plot", "trace-plot", "polar-plot"].map((id) => el(id));
  private shown: { source: Source; detection: Detection; alarm: number; choice: Choice; values: Float32Array | null } | null = null;

  constructor(private readonly channel: (polarization: string, subband: string) => void) {
    const names = ["Range cut", "A-scan", "H/α"];
    const bar = document.querySelector("#plots .tabs")!;
    names.forEach((name, i) => {
      const button = make("button", { type: "button", role: "tab", id: `tab-${i}`, "aria-controls": this.figures[i]!.id }, name);
      button.addEventListener("click", () => this.pick(i));
      button.addEventListener("keydown", (event) => {
        const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? names.length - 1 : 0;
        if (!step) return;
        event.stopPropagation();
        this.pick((i + step) % names.length);
        el(`tab-${this.tab}`).focus();
      });
      bar.append(button);
    });
    this.pick(0);
    new ResizeObserver(() => this.drawPlots()).observe(el("plots"));
  }

  private pick(tab: number): void {
    this.tab = tab;
    this.figures.forEach((figure, i) => {
      figure.hidden = i !== tab && !this.wide();
      el(`tab-${i}`).setAttribute("aria-selected", String(i === tab));
      el(`tab-${i}`).tabIndex = i === tab ? 0 : -1;
    });
    this.drawPlots();
  }

  private wide(): boolean {
    return window.matchMedia("(min-width: 1600px)").matches;
  }

  show(source: Source, detection: Detection, alarm: number, choice: Choice, values: Float32Array | null, colours: Colours): void {
    this.shown = { source, detection, alarm, choice, values };
    this.patches(colours);
    this.features();
    this.pick(this.tab);
  }

  hide(): void {
    this.shown = null;
    this.clearPlots();
  }

  recolour(colours: Colours): void {
    if (this.shown) this.patches(colours);
  }

  redraw(): void {
    if (!this.shown) return;
    this.features();
    this.drawPlots();
  }

  private patches(colours: Colours): void {
    const { source, detection, alarm, choice, values } = this.shown!;
    const home = el("patches");
    home.replaceChildren();
    const evidence = detection.evidence;
    const scans = evidence?.scans[alarm] ?? [];
    if (!evidence || !values || !scans.length) {
      home.append(make("p", { class: "none" }, "No patches are stored for this alarm: no scan sees it, or it is not among the first thousand."));
      return;
    }
    const references = (polarization: string, subband: string): number =>
      source.index.layers.find((one) => one.detection === detection.name && one.polarization === polarization && one.subband === subband)
        ?.percentiles["50"] ?? 0;
    const size = evidence.patch.size;
    const room = Math.max(el("alarm").clientHeight - 88, 150); // below one another the panel is as high as its content
    const tall = room / evidence.polarization.length - 4;
    const broad = (home.clientWidth - 20 - 42 * scans.length) / (scans.length * evidence.subband.length) - 4;
    const zoom = Math.min(tall, Math.max(broad, 44), 72) / size;
    scans.forEach((scan, number) => {
      const parts = partsOf(evidence, values, number, scans.length);
      const head = make("tr", {}, make("td"), ...evidence.subband.map((band) => make("th", { scope: "col" }, band)));
      const body = make("tbody");
      evidence.polarization.forEach((polarization, p) => {
        const row = make("tr", {}, make("th", { scope: "row" }, polarization));
        evidence.subband.forEach((subband, s) => {
          const table = colourTable(colours, references(polarization, subband));
          const canvas = this.patch(parts.patch(p, s), size, zoom, table);
          const peak = Math.max(...[...parts.patch(p, s)].filter(Number.isFinite));
          canvas.setAttribute("role", "img");
          canvas.setAttribute("aria-label", `scan ${scan.scan}, ${polarization} ${subband}, peak ${digits(peak, 3)} dB`);
          canvas.title = `${polarization} ${subband}: peak ${fixed(peak, 1)} dB re background; click to show this channel`;
          if (polarization === choice.polarization && subband === choice.subband) canvas.className = "shown";
          canvas.addEventListener("click", () => this.channel(polarization, subband));
          row.append(make("td", {}, canvas));
        });
        body.append(row);
      });
      home.append(
        make("div", { class: "scan" }, make("h3", {}, `${source.index.aperture ? "all scans" : `scan ${scan.scan}`} `, make("small", {}, `${fixed(scan.distance, 1)} m ahead`)), make("table", {}, make("thead", {}, head), body)),
      );
    });
  }

  private patch(values: Float32Array, size: number, zoom: number, table: Uint32Array): HTMLCanvasElement {
    const canvas = make("canvas", { width: String(size), height: String(size) });
    canvas.style.width = canvas.style.height = `${Math.round(size * zoom)}px`;
    const context = canvas.getContext("2d")!;
    const image = context.createImageData(size, size);
    const out = new Uint32Array(image.data.buffer);
    for (let row = 0; row < size; row++)
      for (let column = 0; column < size; column++) out[(size - 1 - row) * size + column] = table[nearestHalf(values[row * size + column]!)]!;
    context.putImageData(image, 0, 0);
    return canvas;
  }

  private features(): void {
    const { detection, alarm } = this.shown!;
    const home = el("why");
    home.replaceChildren();
    const added = detection.contributions;
    const training = detection.training;
    const legend = training
      ? training.map((one) => make("small", { class: isFalse(one) ? "false" : "hit" }, ` ▬ ${one.label} (${one.count})`))
      : [make("small", {}, `against all ${detection.alarms.x.length} alarms`)];
    const title = training ? "boxes: 5, 25, 50, 75 and 95 % of the training data" : "ticks: the alarms of this result";
    home.append(make("h3", { title }, "Features ", ...legend));
    const sizes = Object.values(added ?? {}).map((column) => Math.abs(column[alarm] ?? 0));
    const most = Math.max(...sizes, 1e-12);
    const names = Object.keys(detection.features);
    const first = names.filter((name) => added?.[name] || names.length <= MOST_FEATURES);
    const rest = names.filter((name) => !first.includes(name));
    const show = (name: string): HTMLElement => this.feature(name, detection.features[name]!, alarm, training, added, most);
    home.append(...first.map(show));
    for (const [name, column] of Object.entries(added ?? {}))
      if (!detection.features[name] && (column[alarm] ?? null) !== null) home.append(make("p", { class: "feature" }, make("span", {}, name), make("span", { class: "added" }, `adds ${digits(column[alarm], 3)}`)));
    if (sizes.some((size) => size > 0)) {
      const total = detection.alarms.confidence[alarm]!;
      home.append(make("p", { class: "added" }, make("small", {}, `contributions add up to the confidence ${digits(total, 4)}`)));
    }
    home.append(...this.causes());
    if (rest.length) {
      const more = make("details", {}, make("summary", {}, `${rest.length} more features`));
      more.addEventListener("toggle", () => more.open && more.childElementCount === 1 && more.append(...rest.map(show)));
      home.append(more);
    }
  }

  /** What each look's value is made of, nearest first, and what explains it without adding up. */
  private causes(): HTMLElement[] {
    const { detection, alarm } = this.shown!;
    const { adds = [], alone = [], causes } = detection.evidence ?? {};
    const looks = causes?.[alarm] ?? [];
    if (!looks.length) return [];
    const mean = (column: number): number => looks.reduce((sum, look) => sum + (look[2] ?? NaN) * (look[column] ?? NaN), 0);
    const cell = (value: number | null, places: number): string => (value === null || Number.isNaN(value) ? "\u2013" : fixed(value, places));
    const table = (title: string, words: string, names: string[], first: number): HTMLElement => {
      const head = ["m", "weight", ...names].map((name) => make("th", { scope: "col", title: name }, name === "likelihood" ? "ln \u039b" : name.replace(/^contrast /, "").replace(/^mine over /, "no ")));
      const row = (cells: string[]): HTMLElement => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));
      const lines = looks.map((look) => row([cell(look[1]!, 1), `${cell(100 * look[2]!, 0)} %`, ...names.map((_, i) => cell(look[first + i]!, 1))]));
      const total = row(["mean", "", ...names.map((_, i) => cell(mean(first + i), 1))]);
      return make("table", { class: "causes" }, make("caption", { title: words }, title), make("thead", {}, make("tr", {}, ...head)), make("tbody", {}, ...lines, total));
    };
    const parts = [table("Looks", "What each look adds to the map at the alarm, and how much it weighs; contributions are the means, times the slope of the regression", adds, 3)];
    if (alone.length) parts.push(table("Each alone", "Log-likelihood ratio of each sub-band's values alone, and log odds of a mine over a stone; they do not add up", alone, 3 + adds.length));
    alone.forEach((name, i) => {
      const [, rival] = name.split(" over ");
      if (rival && !Number.isNaN(mean(3 + adds.length + i))) parts.push(make("p", { class: "added", title: "if it is one of the two, and both were as frequent; fitted for the array, bands and polarizations of the packaged recipe" }, `mine ${fixed(100 / (1 + Math.exp(-mean(3 + adds.length + i))), 0)} %, ${rival} ${fixed(100 / (1 + Math.exp(mean(3 + adds.length + i))), 0)} %, if one of them`));
    });
    return parts;
  }

  private feature(name: string, column: (number | null)[], alarm: number, training: Training[] | null, added: Columns | null, most: number): HTMLElement {
    const value = column[alarm] ?? null;
    const share = added?.[name]?.[alarm];
    const words = share === undefined || share === null ? "" : `${share < 0 ? "\u2212" : "+"}${digits(Math.abs(share), 3)}`;
    const box = make("div", { class: "feature" }, make("span", {}, name, " ", make("b", {}, digits(value, 4))), make("span", { class: "added", title: "contribution to the confidence" }, words && `adds ${words}`));
    const others = column.filter((one): one is number => one !== null);
    const boxes = (training ?? [])
      .map((one) => ({ ink: colour(isFalse(one) ? "false" : "hit"), q: (one.quantiles[name] ?? []).filter((v): v is number => v !== null) }))
      .filter(({ q }) => q.length === 7);
    const references = boxes.map(({ q }) => q);
    const all = [...(references.length ? references.flatMap((q) => [q[1]!, q[5]!]) : others), ...(value === null ? [] : [value])];
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const place = (v: number): number => 3 + (194 * (Math.min(Math.max(v, low), high) - low)) / (high - low || 1);
    const drawing = svg("svg", { viewBox: "0 0 200 16", preserveAspectRatio: "none", role: "img", "aria-label": this.inWords(name, value, others) });
    drawing.append(svg("line", { x1: 3, x2: 197, y1: 13.5, y2: 13.5, stroke: colour("line"), "stroke-width": 1 }));
    if (references.length)
      boxes.slice(0, 2).forEach(({ q, ink }, i) => {
        const y = 3 + i * 6;
        drawing.append(svg("line", { x1: place(q[1]!), x2: place(q[5]!), y1: y, y2: y, stroke: ink, "stroke-width": 1 }));
        drawing.append(svg("rect", { x: place(q[2]!), width: Math.max(place(q[4]!) - place(q[2]!), 1), y: y - 2, height: 4, fill: ink, opacity: 0.55 }));
        drawing.append(svg("line", { x1: place(q[3]!), x2: place(q[3]!), y1: y - 2.5, y2: y + 2.5, stroke: ink, "stroke-width": 1.5 }));
      });
    else {
      const stride = Math.max(1, Math.floor(others.length / 300));
      for (let i = 0; i < others.length; i += stride) drawing.append(svg("line", { x1: place(others[i]!), x2: place(others[i]!), y1: 5, y2: 11, stroke: colour("soft"), "stroke-width": 0.8, opacity: 0.6 }));
    }
    if (value !== null) drawing.append(svg("line", { x1: place(value), x2: place(value), y1: 0, y2: 14, stroke: colour("accent"), "stroke-width": 2.5 }));
    box.append(drawing);
    if (share !== undefined && share !== null) {
      const width = (96 * Math.abs(share)) / most;
      const bar = svg("svg", { viewBox: "0 0 200 6", preserveAspectRatio: "none", "aria-hidden": "true", class: "share" });
      bar.append(svg("rect", { x: share < 0 ? 100 - width : 100, y: 1, width, height: 4, fill: share < 0 ? colour("missed") : colour("accent") }));
      bar.append(svg("line", { x1: 100, x2: 100, y1: 0, y2: 6, stroke: colour("soft"), "stroke-width": 1 }));
      box.append(bar);
    }
    return box;
  }

  private inWords(name: string, value: number | null, others: number[]): string {
    if (value === null) return `${name}: unknown`;
    const below = others.filter((one) => one < value).length;
    return `${name} ${digits(value, 4)}, above ${Math.round((100 * below) / Math.max(others.length, 1))} percent of the alarms`;
  }

  private clearPlots(): void {
    for (const plot of this.plots) plot.destroy();
    this.plots = [];
    for (const figure of this.figures) figure.replaceChildren();
  }

  private drawPlots(): void {
    this.clearPlots();
    if (!this.shown) return;
    const wide = this.wide();
    this.figures.forEach((figure, i) => {
      figure.hidden = i !== this.tab && !wide;
      if (figure.hidden) return;
      if (i === 2) this.polar(figure);
      else this.curves(figure, i === 0);
    });
  }

  private curves(figure: HTMLElement, cut: boolean): void {
    const { detection, alarm, choice, values } = this.shown!;
    const evidence = detection.evidence;
    const scans = evidence?.scans[alarm] ?? [];
    const x = cut ? evidence?.cut : evidence?.trace;
    if (!evidence || !values || !scans.length || !x?.length) {
      figure.append(make("p", { class: "none" }, cut ? "No range cut is stored." : "No A-scan is stored."));
      return;
    }
    const p = Math.max(evidence.polarization.indexOf(choice.polarization), 0);
    const s = Math.max(evidence.subband.indexOf(choice.subband), 0);
    const lines = scans.map((_, number) => {
      const parts = partsOf(evidence, values, number, scans.length);
      return Array.from(cut ? parts.cut(p, s) : parts.trace(p), (v) => (Number.isFinite(v) ? v : null));
    });
    const near = lines.flatMap((line) => line.filter((v, i): v is number => v !== null && Math.abs(x[i]!) <= 0.5));
    const shift = cut ? 0 : Math.max(...near);
    const title = cut ? `Range cut ${evidence.polarization[p]} ${evidence.subband[s]}` : `A-scan ${evidence.polarization[p]}, all tones and pairs`;
    const heading = make("h3", {}, title);
    figure.append(heading);
    const axis = { stroke: colour("soft"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line"), size: 3 }, font: "11px system-ui", labelFont: "11px system-ui" };
    const key = make("p", {});
    scans.forEach((scan, i) => {
      const dot = svg("svg", { width: 14, height: 8, "aria-hidden": "true" }, svg("line", { x1: 0, x2: 12, y1: 4, y2: 4, stroke: LINES[i % LINES.length]!, "stroke-width": 2.5 }));
      key.append(dot, make("small", {}, ` ${fixed(scan.distance, 1)} m  `));
    });
    this.plots.push(
      new uPlot(
        {
          width: Math.max(figure.clientWidth, 120),
          height: Math.max(Math.min(figure.clientHeight, el("alarm").clientHeight - 60) - 44, 110),
          legend: { show: false },
          cursor: { drag: { x: false, y: false } },
          scales: { x: { time: false }, y: cut ? { range: (_u, low, high) => [Math.max(low, high - 60), high + 2] } : { range: [-35, 15] } },
          axes: [
            { ...axis, label: "range about the alarm (m)", labelSize: 14, size: 26 },
            { ...axis, label: cut ? "dB re background" : "dB re peak within 0.5 m", labelSize: 14, size: 36 },
          ],
          series: [{}, ...lines.map((_, i) => ({ stroke: LINES[i % LINES.length]!, width: 1.6, points: { show: false } }))],
          hooks: {
            draw: [
              (u) => {
                const at = u.valToPos(0, "x", true);
                u.ctx.save();
                u.ctx.strokeStyle = colour("soft");
                u.ctx.setLineDash([4, 4]);
                u.ctx.beginPath();
                u.ctx.moveTo(at, u.bbox.top);
                u.ctx.lineTo(at, u.bbox.top + u.bbox.height);
                u.ctx.stroke();
                u.ctx.restore();
              },
            ],
          },
        },
        [x, ...lines.map((line) => line.map((v) => (v === null ? null : v - shift)))] as uPlot.AlignedData,
        figure,
      ),
    );
    figure.append(key);
  }

  /** Entropy and alpha with the bounds of what is possible (Cloude and Pottier 1997). */
  private polar(figure: HTMLElement): void {
    const { detection, alarm } = this.shown!;
    const entropy = detection.features["entropy"] ?? detection.evidence?.polarimetric["entropy"];
    const alpha = detection.features["alpha"] ?? detection.evidence?.polarimetric["alpha"];
    const [h, a] = [entropy?.[alarm], alpha?.[alarm]];
    if (h === undefined || h === null || a === undefined || a === null) {
      figure.append(make("p", { class: "none" }, "No polarimetric point: it needs HH, VV and a cross-polarization."));
      return;
    }
    figure.append(make("h3", {}, `Entropy ${fixed(h, 2)}, α ${fixed((a * 180) / Math.PI, 0)}°`));
    const [width, height] = [Math.max(figure.clientWidth, 120), Math.max(Math.min(figure.clientHeight, el("alarm").clientHeight - 60) - 24, 120)];
    const X = (v: number): number => 36 + v * (width - 46);
    const Y = (v: number): number => height - 32 - (v / (Math.PI / 2)) * (height - 42);
    const drawing = svg("svg", { width, height, role: "img", "aria-label": `entropy ${fixed(h, 2)}, alpha ${fixed((a * 180) / Math.PI, 0)} degrees` });
    const text = (x: number, y: number, words: string, anchor = "middle"): void => {
      const node = svg("text", { x, y, "text-anchor": anchor, "font-size": 11, fill: colour("soft") });
      node.textContent = words;
      drawing.append(node);
    };
    drawing.append(svg("rect", { x: X(0), y: Y(Math.PI / 2), width: X(1) - X(0), height: Y(0) - Y(Math.PI / 2), fill: "none", stroke: colour("line") }));
    const entropyOf = (...p: number[]): number => -p.reduce((sum, q) => sum + (q > 0 ? q * Math.log(q) : 0), 0) / Math.log(3);
    const m = Array.from({ length: 61 }, (_, i) => i / 60);
    const lower = m.map((v) => [entropyOf(1 / (1 + 2 * v), v / (1 + 2 * v), v / (1 + 2 * v)), (v * Math.PI) / (1 + 2 * v)]);
    const upper = m.map((v) => {
      const q = v <= 0.5 ? [0, 1 / (1 + 2 * v), (2 * v) / (1 + 2 * v)] : [(2 * v - 1) / (1 + 2 * v), 1 / (1 + 2 * v), 1 / (1 + 2 * v)];
      return [entropyOf(...q), (Math.PI / 2) * (1 - q[0]!)];
    });
    const bound = [...lower, ...upper.reverse()].map(([x, y], i) => `${i ? "L" : "M"}${X(x!).toFixed(1)} ${Y(y!).toFixed(1)}`).join("");
    drawing.append(svg("path", { d: bound, fill: colour("well"), stroke: colour("soft"), "stroke-width": 1, "fill-opacity": 0.6 }));
    const stride = Math.max(1, Math.floor((entropy?.length ?? 0) / 500));
    for (let i = 0; i < (entropy?.length ?? 0); i += stride) {
      const [x, y] = [entropy![i], alpha?.[i]];
      if (typeof x === "number" && typeof y === "number") drawing.append(svg("circle", { cx: X(x), cy: Y(y), r: 2.2, fill: colour("soft"), opacity: 0.7 }));
    }
    drawing.append(svg("circle", { cx: X(h), cy: Y(a), r: 6, fill: colour("accent"), stroke: colour("card"), "stroke-width": 2 }));
    for (const v of [0, 0.5, 1]) text(X(v), height - 18, String(v));
    for (const v of [0, 45, 90]) text(30, Y((v * Math.PI) / 180) + 4, `${v}°`, "end");
    text(X(0.5), height - 4, "entropy H; mean angle α upwards");
    figure.append(drawing);
  }
}
