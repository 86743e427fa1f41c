import { colourAt, colourTable, type Colours } from "./colour";
import { layerNumber, type Tiles } from "./data";
import { colour } from "./dom";
import { CanvasPen, type Pen } from "./pen";
import type { Choice, Source } from "./types";
import { ticks, View, type Box } from "./view";

const MARGIN = { left: 46, right: 52, top: 8, bottom: 34 };
const MOST_PAINTED = 160;

interface Palette { text: string; axis: string; paper: string; unseen: string }

/** The picture of the lane: tiles, painted by look-up, and what is drawn over them. */
export class Picture {
  readonly view: View;
  private painted = new Map<string, HTMLCanvasElement>();
  private tables = new Map<string, Uint32Array>();
  private colours: Colours = { map: "viridis", floor: 0, range: 30 };
  private hatching: { ink: string; tile: HTMLCanvasElement } | null = null;
  private readonly holed = new WeakSet<HTMLCanvasElement>();
  /** Whether a tile that was painted has ground that no scan has seen. */
  gaps = false;
  /** Whether ground that no scan has seen is striped. */
  striped = true;

  constructor(
    private readonly sources: Source[],
    private readonly tiles: Tiles,
    view: View,
  ) {
    this.view = view;
  }

  recolour(colours: Colours): void {
    this.colours = { ...colours };
    this.tables.clear();
    this.painted.clear();
  }

  /** Paint tiles anew when they are next drawn. */
  repaint(source: number, layer: number, tiles: number[]): void {
    for (const tile of tiles) for (const turned of [true, false]) this.painted.delete(`${source}/${layer}/0/${tile}/${turned}`);
  }

  /** Where the picture lies on a canvas. */
  static box(width: number, height: number): Box {
    return {
      left: MARGIN.left,
      top: MARGIN.top,
      width: Math.max(width - MARGIN.left - MARGIN.right, 10),
      height: Math.max(height - MARGIN.top - MARGIN.bottom, 10),
    };
  }

  private table(reference: number): Uint32Array {
    const key = String(reference);
    let table = this.tables.get(key);
    if (!table) this.tables.set(key, (table = colourTable(this.colours, reference)));
    return table;
  }

  /** Draw the visible tiles of a choice into a part of the box; true when all are there at the wanted level. */
  raster(context: CanvasRenderingContext2D, choice: Choice, clip: Box, smooth: boolean, density: number): boolean {
    const source = this.sources[choice.source];
    const grid = source?.index.grid;
    const number = source ? layerNumber(source, choice) : -1;
    const layer = source?.index.layers[number];
    if (!source || !grid || !layer) return true;
    const { view } = this;
    const wanted = Math.floor(Math.log2(1 / (view.scale * density * grid.dy)));
    const level = Math.min(Math.max(wanted, 0), layer.levels.length - 1);
    const table = this.table(layer.percentiles["50"] ?? 0);
    context.save();
    context.beginPath();
    context.rect(clip.left, clip.top, clip.width, clip.height);
    context.clip();
    let whole = true;
    for (const depth of level < layer.levels.length - 1 ? [layer.levels.length - 1, level] : [level]) {
      const complete = this.levelOf(context, choice.source, number, depth, table, smooth, depth !== level);
      if (depth === level) whole = complete;
    }
    context.restore();
    return whole;
  }

  private levelOf(
    context: CanvasRenderingContext2D,
    source: number,
    number: number,
    level: number,
    table: Uint32Array,
    smooth: boolean,
    backdrop: boolean,
  ): boolean {
    const index = this.sources[source]!.index;
    const grid = index.grid!;
    const { view } = this;
    const step = grid.dy * 2 ** level;
    const first = grid.y - grid.dy / 2;
    const rows = index.layers[number]!.levels[level]!.rows;
    const [low, high] = view.span();
    const from = Math.max(Math.floor((low - first) / step / index.tile_rows), 0);
    const to = Math.min(Math.floor((high - first) / step / index.tile_rows), Math.ceil(rows / index.tile_rows) - 1);
    context.imageSmoothingEnabled = smooth || step * view.scale < 0.99;
    context.imageSmoothingQuality = "medium";
    const isStored = index.layers[number]!.levels[level]!.file !== "";
    let whole = true;
    if (backdrop) {
      let missing = false;
      const fine = this.levelNeeded(source, number, level);
      for (const one of fine) missing ||= !this.tiles.peek(source, number, one.level, one.tile);
      if (!missing) return true;
    }
    for (let tile = from; tile <= to; tile++) {
      const data = this.tile(source, number, level, tile);
      if (!data) {
        whole &&= !isStored;
        continue;
      }
      const bitmap = this.paint(`${source}/${number}/${level}/${tile}`, data, grid.nx, table);
      const start = first + tile * index.tile_rows * step;
      const end = start + (data.length / grid.nx) * step;
      const a = view.toScreen(grid.x - grid.dx / 2, start);
      const b = view.toScreen(grid.x + (grid.nx - 0.5) * grid.dx, end);
      const [left, right] = [Math.round(Math.min(a[0], b[0])), Math.round(Math.max(a[0], b[0]))];
      const [top, bottom] = [Math.round(Math.min(a[1], b[1])), Math.round(Math.max(a[1], b[1]))];
      if (this.striped && this.holed.has(bitmap)) this.hatch(context, view.toScreen(grid.x - grid.dx / 2, start), view.toScreen(grid.x + (grid.nx - 0.5) * grid.dx, Math.min(end, first + rows * step)));
      context.drawImage(bitmap, left, top, Math.max(right - left, 1), Math.max(bottom - top, 1));
    }
    return whole;
  }

  /** A tile, asked for where it lies in a file: those of a live run come by its events alone. */
  private tile(source: number, layer: number, level: number, tile: number): Uint16Array | null {
    const isStored = this.sources[source]!.index.layers[layer]!.levels[level]!.file !== "";
    return isStored ? this.tiles.get(source, layer, level, tile) : this.tiles.peek(source, layer, level, tile);
  }

  /** Fill the ground between two corners with stripes: what is drawn over it has holes. */
  private hatch(context: CanvasRenderingContext2D, a: [number, number], b: [number, number]): void {
    const ink = colour("hatch");
    if (this.hatching?.ink !== ink) {
      const tile = document.createElement("canvas");
      tile.width = tile.height = 8;
      const pen = tile.getContext("2d")!;
      pen.fillStyle = colour("unseen");
      pen.fillRect(0, 0, 8, 8);
      pen.strokeStyle = ink;
      pen.lineWidth = 1.5;
      for (const at of [-8, 0, 8]) {
        pen.moveTo(at, 8);
        pen.lineTo(at + 8, 0);
      }
      pen.stroke();
      this.hatching = { ink, tile };
    }
    context.fillStyle = context.createPattern(this.hatching.tile, "repeat")!;
    const [left, top] = [Math.min(a[0], b[0]), Math.min(a[1], b[1])];
    context.fillRect(left, top, Math.abs(b[0] - a[0]), Math.abs(b[1] - a[1]));
  }

  private levelNeeded(source: number, number: number, coarsest: number): { level: number; tile: number }[] {
    const index = this.sources[source]!.index;
    const grid = index.grid!;
    const [low, high] = this.view.span();
    const needed: { level: number; tile: number }[] = [];
    const density = window.devicePixelRatio || 1;
    const level = Math.min(Math.max(Math.floor(Math.log2(1 / (this.view.scale * density * grid.dy))), 0), coarsest);
    const length = index.tile_rows * grid.dy * 2 ** level;
    const rows = index.layers[number]!.levels[level]!.rows;
    const last = Math.ceil(rows / index.tile_rows) - 1;
    for (let tile = Math.max(Math.floor((low - grid.y) / length), 0); tile <= Math.min(Math.floor((high - grid.y) / length), last); tile++)
      needed.push({ level, tile });
    return needed;
  }

  private paint(name: string, data: Uint16Array, nx: number, table: Uint32Array): HTMLCanvasElement {
    const key = `${name}/${this.view.turned}`;
    const known = this.painted.get(key);
    if (known) {
      this.painted.delete(key);
      this.painted.set(key, known);
      return known;
    }
    const rows = data.length / nx;
    const bitmap = document.createElement("canvas");
    bitmap.width = this.view.turned ? nx : rows;
    bitmap.height = this.view.turned ? rows : nx;
    const context = bitmap.getContext("2d")!;
    const image = context.createImageData(bitmap.width, bitmap.height);
    const out = new Uint32Array(image.data.buffer);
    if (this.view.turned) {
      for (let row = 0; row < rows; row++)
        for (let column = 0, at = (rows - 1 - row) * nx; column < nx; column++) out[at + column] = table[data[row * nx + column]!]!;
    } else {
      for (let row = 0; row < rows; row++)
        for (let column = 0; column < nx; column++) out[column * rows + row] = table[data[row * nx + column]!]!;
    }
    context.putImageData(image, 0, 0);
    if (out.includes(0)) {
      this.holed.add(bitmap);
      this.gaps = true;
    }
    this.painted.set(key, bitmap);
    for (const old of this.painted.keys()) {
      if (this.painted.size <= MOST_PAINTED) break;
      this.painted.delete(old);
    }
    return bitmap;
  }

  /** The whole lane in a strip, from the coarsest level, which is one tile unless the lane still grows. */
  overview(context: CanvasRenderingContext2D, choice: Choice, box: Box): void {
    const source = this.sources[choice.source];
    const grid = source?.index.grid;
    const number = source ? layerNumber(source, choice) : -1;
    const layer = source?.index.layers[number];
    if (!source || !grid || !layer) return;
    const level = layer.levels.length - 1;
    const extent = this.view.extent;
    const scale = (box.width / (extent.y_max - extent.y_min)) * grid.dy * 2 ** level;
    const start = ((grid.y - grid.dy / 2 - extent.y_min) * box.width) / (extent.y_max - extent.y_min);
    const turned = this.view.turned;
    this.view.turned = false;
    context.save();
    context.beginPath();
    context.rect(box.left, box.top, box.width, box.height);
    context.clip();
    context.imageSmoothingEnabled = true;
    for (let tile = 0; tile * source.index.tile_rows < layer.levels[level]!.rows; tile++) {
      const data = this.tile(choice.source, number, level, tile);
      if (!data) continue;
      const bitmap = this.paint(`${choice.source}/${number}/${level}/${tile}`, data, grid.nx, this.table(layer.percentiles["50"] ?? 0));
      const [from, rows] = [tile * source.index.tile_rows * scale, (data.length / grid.nx) * scale];
      context.drawImage(bitmap, box.left + start + from, box.top, rows, box.height);
    }
    context.restore();
    this.view.turned = turned;
  }

  /** Value of a choice under a point of the lane, from the finest tile that has arrived: NaN where no scan has seen it, null beside the grid. */
  value(choice: Choice, x: number, y: number, halves: Float32Array): number | null {
    const source = this.sources[choice.source];
    const grid = source?.index.grid;
    const number = source ? layerNumber(source, choice) : -1;
    if (!source || !grid || number < 0) return null;
    const column = Math.round((x - grid.x) / grid.dx);
    const row = Math.round((y - grid.y) / grid.dy);
    if (column < 0 || column >= grid.nx || row < 0 || row >= grid.ny) return null;
    const levels = source.index.layers[number]!.levels.length;
    for (let level = 0; level < levels; level++) {
      const at = row >> level;
      const tile = Math.floor(at / source.index.tile_rows);
      const data = this.tiles.peek(choice.source, number, level, tile);
      if (data) return halves[data[(at - tile * source.index.tile_rows) * grid.nx + column]!]!;
    }
    return null;
  }

  axes(pen: Pen, palette: Palette): void {
    const { view } = this;
    const { left, top, width, height } = view.box;
    const [y0, y1] = view.span();
    const halfX = view.across / view.scaleX / 2;
    const line = { stroke: palette.axis, width: 1 };
    pen.path([[left, top], [left + width, top], [left + width, top + height], [left, top + height]], true, line);
    const horizontal = view.turned ? ticks(view.x - halfX, view.x + halfX, width / 70) : ticks(y0, y1, width / 80);
    const vertical = view.turned ? ticks(y0, y1, height / 50) : ticks(view.x - halfX, view.x + halfX, height / 40);
    for (const value of horizontal) {
      const [px] = view.turned ? view.toScreen(value, view.y) : view.toScreen(view.x, value);
      pen.path([[px, top + height], [px, top + height + 4]], false, line);
      const atEnd = px > left + width - 14;
      pen.text(atEnd ? left + width : px, top + height + 16, format(value), { fill: palette.text, size: 11, anchor: atEnd ? "end" : "middle" });
    }
    for (const value of vertical) {
      const [, py] = view.turned ? view.toScreen(view.x, value) : view.toScreen(value, view.y);
      pen.path([[left - 4, py], [left, py]], false, line);
      pen.text(left - 7, py + 4, format(value), { fill: palette.text, size: 11, anchor: "end" });
    }
    const [below, beside] = view.turned ? ["x, cross-track (m)", "y, down-track (m)"] : ["y, down-track (m)", "x, right + (m)"];
    pen.text(left + width / 2, top + height + 30, below, { fill: palette.text, size: 11, anchor: "middle" });
    pen.text(12, top + height / 2, beside, { fill: palette.text, size: 11, anchor: "middle", turn: true });
  }
}

/** Colour bar in the right margin, from `top` to the bottom of the picture. */
export function colourBar(pen: Pen, box: Box, colours: Colours, palette: Palette, top: number): void {
  const height = box.top + box.height - top - 2;
  if (height < 40) return;
  const left = box.left + box.width + 10;
  const steps = 64;
  for (let i = 0; i < steps; i++) {
    const y = top + height * (1 - (i + 1) / steps);
    const fill = `rgb(${colourAt(colours.map, i / (steps - 1)).join(",")})`;
    pen.path([[left, y], [left + 10, y], [left + 10, y + height / steps + 0.6], [left, y + height / steps + 0.6]], true, { fill });
  }
  for (const value of ticks(colours.floor, colours.floor + colours.range, height / 40)) {
    const y = top + height * (1 - (value - colours.floor) / colours.range);
    pen.text(left + 13, y + 4, format(value), { fill: palette.text, size: 10.5 });
  }
  pen.text(left - 2, box.top + box.height + 14, "dB re", { fill: palette.text, size: 10.5 });
  pen.text(left - 2, box.top + box.height + 27, "median", { fill: palette.text, size: 10.5 });
}

export function format(value: number): string {
  const text = String(Math.round(value * 1e6) / 1e6);
  return text.startsWith("-") ? "\u2212" + text.slice(1) : text;
}

export function canvasPen(context: CanvasRenderingContext2D): Pen {
  return new CanvasPen(context);
}

export type { Palette };
