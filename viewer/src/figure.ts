import { colour, el } from "./dom";
import { download, withRaster } from "./exports";
import { canvasPen, type Palette } from "./lane";
import { SvgPen, type Pen } from "./pen";
import type { View } from "./view";

const HEAD = 30;
const FACTOR = 2;

export interface FigureParts {
  title: string;
  palette: Palette;
  raster: (context: CanvasRenderingContext2D, factor: number) => void;
  over: (pen: Pen) => void;
  around: (pen: Pen, palette: Palette) => void;
}

function heading(pen: Pen, view: View, parts: FigureParts, y: number): void {
  pen.text(view.box.left, y, parts.title, { fill: parts.palette.text, size: 13, bold: true });
}

function background(context: CanvasRenderingContext2D, view: View, parts: FigureParts): void {
  const { left, top, width, height } = view.box;
  context.fillStyle = parts.palette.unseen;
  context.fillRect(left, top, width, height);
  parts.raster(context, FACTOR);
}

/** The picture with title, axes and colour bar, with twice the pixels of the screen. */
export function savePng(parts: FigureParts, view: View): void {
  const lane = el<HTMLCanvasElement>("lane");
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [lane.clientWidth * FACTOR, (lane.clientHeight + HEAD) * FACTOR];
  const context = canvas.getContext("2d")!;
  context.scale(FACTOR, FACTOR);
  context.fillStyle = colour("paper");
  context.fillRect(0, 0, lane.clientWidth, lane.clientHeight + HEAD);
  const pen = canvasPen(context);
  heading(pen, view, parts, HEAD - 7);
  context.translate(0, HEAD);
  background(context, view, parts);
  context.save();
  context.beginPath();
  context.rect(view.box.left, view.box.top, view.box.width, view.box.height);
  context.clip();
  parts.over(pen);
  context.restore();
  parts.around(pen, parts.palette);
  canvas.toBlob((blob) => blob && download("flgpr-lane.png", blob));
}

/** The same with symbols, axes and words as vectors; the run-view itself stays an image. */
export function saveSvg(parts: FigureParts, view: View): void {
  const lane = el<HTMLCanvasElement>("lane");
  const { left, top, width, height } = view.box;
  const raster = document.createElement("canvas");
  [raster.width, raster.height] = [Math.round(width * FACTOR), Math.round(height * FACTOR)];
  const context = raster.getContext("2d")!;
  context.scale(FACTOR, FACTOR);
  context.translate(-left, -top);
  background(context, view, parts);
  const [inside, around] = [new SvgPen(), new SvgPen()];
  parts.over(inside);
  parts.around(around, parts.palette);
  heading(around, view, parts, -7);
  const clip = `<clipPath id="lane"><rect x="${left}" y="${top}" width="${width}" height="${height}"/></clipPath>`;
  const body =
    withRaster(raster.toDataURL("image/png"), left, top + HEAD, width, height, colour("paper"), parts.title) +
    `<g transform="translate(0 ${HEAD})">${clip}<g clip-path="url(#lane)">${inside.parts.join("")}</g>${around.parts.join("")}</g>`;
  download("flgpr-lane.svg", new SvgPen().svg(lane.clientWidth, lane.clientHeight + HEAD, body), "image/svg+xml");
}
