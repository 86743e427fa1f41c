import type { Pen, Point } from "./pen";

/** Symbols carry their meaning by shape first and by colour (Okabe and Ito) second; a dark edge keeps them apart from any map. */
export const SHADOW = "#10151c";
export const INK: Record<string, string> = {
  detection: "#7fd4ff",
  ignored: "#d4dde6",
  false: "#ffb84d",
  outside: "#d4dde6",
  plain: "#ffffff",
  found: "#ffffff",
  missed: "#ff7a59",
};
export const LABELS: Record<string, string> = {
  detection: "hit: best alarm of a target",
  ignored: "in a target's halo",
  false: "false alarm",
  outside: "outside the lane",
  plain: "alarm",
};
export const SHORT: Record<string, string> = { detection: "hit", ignored: "in halo", false: "false", outside: "outside", plain: "" };

function twice(draw: (ink: string, width: number) => void, ink: string, width: number): void {
  draw(SHADOW, width + 2.4);
  draw(ink, width);
}

export function drawAlarm(pen: Pen, x: number, y: number, label: string, size = 6, second = false): void {
  const ink = INK[label] ?? INK["plain"]!;
  const outline = (stroke: string, width: number): void => {
    if (second) {
      const r = size * 1.25;
      pen.path([[x, y - r], [x + r, y], [x, y + r], [x - r, y]], true, { stroke, width });
    } else if (label === "outside") pen.ellipse(x, y, size * 0.7, size * 0.7, { stroke, width: width * 0.8 });
    else pen.ellipse(x, y, size, size, { stroke, width });
  };
  twice(outline, ink, 1.8);
  const inner = size * 0.42;
  if (label === "detection") pen.ellipse(x, y, inner, inner, { fill: ink, stroke: SHADOW, width: 1 });
  if (label === "false") {
    const cross = (stroke: string, width: number): void => {
      pen.path([[x - inner, y - inner], [x + inner, y + inner]], false, { stroke, width });
      pen.path([[x - inner, y + inner], [x + inner, y - inner]], false, { stroke, width });
    };
    twice(cross, ink, 1.5);
  }
}

/** Corners of a target's symbol by kind: square for metal, triangle for plastic, diamond for simulant, hexagon for others. */
export function targetShape(kind: string, x: number, y: number, r: number): Point[] {
  const corner = (count: number, start: number, size: number): Point[] =>
    Array.from({ length: count }, (_, i) => {
      const angle = start + (2 * Math.PI * i) / count;
      return [x + size * Math.cos(angle), y + size * Math.sin(angle)];
    });
  if (kind === "metal") return corner(4, Math.PI / 4, r * 1.25);
  if (kind === "plastic") return corner(3, -Math.PI / 2, r * 1.3);
  if (kind === "simulant") return corner(4, 0, r * 1.25);
  return corner(6, 0, r * 1.1);
}

/** Depth fills the symbol: hollow is flush, full is the deepest of the lane. */
export function drawTarget(pen: Pen, x: number, y: number, kind: string, depth: number, missed: boolean, faded = false, r = 5): void {
  const ink = missed ? INK["missed"]! : INK["found"]!;
  const alpha = faded ? 0.3 : 1;
  const shape = targetShape(kind, x, y, r);
  pen.path(shape, true, { stroke: SHADOW, width: 4, alpha });
  pen.path(shape, true, { stroke: ink, width: 1.8, alpha });
  if (depth > 0) pen.path(targetShape(kind, x, y, r * Math.sqrt(depth) * 0.86), true, { fill: ink, alpha });
}

/** A target's halo, and the border of the lane. */
export const HALO = { stroke: "#ffffff", width: 1, dash: [3, 4] };
export const BORDER = { stroke: "#ffffff", width: 1.2, dash: [7, 4] };

export function drawObject(pen: Pen, x: number, y: number, r = 4): void {
  const bars: Point[][] = [[[x - r, y], [x + r, y]], [[x, y - r], [x, y + r]]];
  for (const bar of bars) pen.path(bar, false, { stroke: SHADOW, width: 3.6 });
  for (const bar of bars) pen.path(bar, false, { stroke: "#d4dde6", width: 1.4 });
}
