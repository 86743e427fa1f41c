import { setLabel } from "./data";
import type { Shown } from "./page";
import type { Pen } from "./pen";
import type { Choice } from "./types";
import type { Box } from "./view";

/** Draw the rasters that are in sight; tell whether all of their tiles are there. */
export function rasters(app: Shown, context: CanvasRenderingContext2D, density: number): boolean {
  const { box } = app.view;
  const draw = (choice: Choice, clip: Box): boolean => app.picture.raster(context, choice, clip, app.smooth, density);
  if (app.compare === "swipe") {
    const at = app.view.turned ? box.height * app.divide : box.width * app.divide;
    const first = app.view.turned ? { ...box, height: at } : { ...box, width: at };
    const rest = app.view.turned ? { ...box, top: box.top + at, height: box.height - at } : { ...box, left: box.left + at, width: box.width - at };
    const [a, b] = [draw(app.a, first), draw(app.b, rest)];
    return a && b;
  }
  return draw(app.compare === "blink" && app.flipped ? app.b : app.a, box);
}

/** Draw the line between A and B and say which is which. */
export function drawComparison(app: Shown, pen: Pen): void {
  const { box, turned } = app.view;
  if (app.compare === "off") return;
  const words = (choice: Choice, name: string): string => {
    const source = app.sources[choice.source]!;
    const result = app.sources.length > 1 ? `${source.title.split(" ")[0]}, ` : "";
    return `${name}: ${result}${setLabel(source, choice.set)}, ${choice.polarization} ${choice.subband}`;
  };
  const style = { fill: "#ffffff", halo: "#10151c", size: 12, bold: true };
  if (app.compare === "blink") {
    const [choice, name] = app.flipped ? [app.b, "B"] : [app.a, "A"];
    pen.text(box.left + 10, box.top + box.height - 10, words(choice, name), style);
    return;
  }
  const at = turned ? box.top + box.height * app.divide : box.left + box.width * app.divide;
  const line: [number, number][] = turned ? [[box.left, at], [box.left + box.width, at]] : [[at, box.top], [at, box.top + box.height]];
  pen.path(line, false, { stroke: "#10151c", width: 5 });
  pen.path(line, false, { stroke: "#ffe45c", width: 2 });
  if (turned) {
    pen.text(box.left + 10, at - 8, words(app.a, "A"), style);
    pen.text(box.left + 10, at + 18, words(app.b, "B"), style);
  } else {
    pen.text(at - 8, box.top + box.height - 10, words(app.a, "A"), { ...style, anchor: "end" });
    pen.text(at + 8, box.top + box.height - 10, words(app.b, "B"), style);
  }
}
