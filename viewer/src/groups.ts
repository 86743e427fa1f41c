import type { Pen, Point } from "./pen";
import { drawAlarm, INK, SHADOW } from "./symbols";
import type { Detection } from "./types";
import type { View } from "./view";

/** Alarms of one cell of the picture, drawn as one symbol with their number. */
export interface Group {
  px: number;
  py: number;
  rows: number[];
}

/** Side of a cell, px, and how far from its middle the symbol of its alarms may lie: symbols of neighbours stay apart. */
const CELL = 36;
const OFF_MIDDLE = 6;
/** Side of the square that an alarm's symbol takes, px; alarms are grouped where symbols would cover more than this share. */
const SYMBOL = 13;
const MOST_COVERED = 0.5;
/** So few alarms are never grouped. */
const FEW = 200;
const LARGEST = 13;
/** Symbols keep this distance from the edges of the picture, px. */
const EDGE = 10;

/**
 * Return the alarms in sight by cells of the picture, or null where there is room for each of them.
 *
 * Cells are fixed to the ground, so that groups stay together while the picture moves.
 */
export function groupAlarms(view: View, detection: Detection, visible: (row: number) => boolean): Group[] | null {
  const { x: xs, y: ys } = detection.alarms;
  if (xs.length <= FEW) return null;
  const { left, top, width, height } = view.box;
  const cells = new Map<string, { rows: number[]; sumX: number; sumY: number; middle: Point }>();
  const [originX, originY] = cornerOf(view);
  let count = 0;
  for (let row = 0; row < xs.length; row++) {
    if (!visible(row)) continue;
    const [px, py] = view.toScreen(xs[row]!, ys[row]!);
    if (px < left || px > left + width || py < top || py > top + height) continue;
    count++;
    const column = Math.floor((px - originX) / CELL);
    const line = Math.floor((py - originY) / CELL);
    const key = `${column}/${line}`;
    let cell = cells.get(key);
    if (!cell) {
      const middle: Point = [originX + (column + 0.5) * CELL, originY + (line + 0.5) * CELL];
      cells.set(key, (cell = { rows: [], sumX: 0, sumY: 0, middle }));
    }
    cell.rows.push(row);
    cell.sumX += px;
    cell.sumY += py;
  }
  if (count <= FEW || count * SYMBOL ** 2 <= MOST_COVERED * groundInSight(view)) return null;
  const within = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
  const near = (mean: number, middle: number): number => within(mean, middle - OFF_MIDDLE, middle + OFF_MIDDLE);
  return [...cells.values()].map(({ rows, sumX, sumY, middle }) => ({
    px: within(near(sumX / rows.length, middle[0]), left + EDGE, left + width - EDGE),
    py: within(near(sumY / rows.length, middle[1]), top + EDGE, top + height - EDGE),
    rows,
  }));
}

/** The upper left corner of the lane in the picture. */
function cornerOf(view: View): Point {
  const [ax, ay] = view.toScreen(view.extent.x_min, view.extent.y_min);
  const [bx, by] = view.toScreen(view.extent.x_max, view.extent.y_max);
  return [Math.min(ax, bx), Math.min(ay, by)];
}

/** Area of the lane's ground in the picture, px². */
function groundInSight(view: View): number {
  const { left, top, width, height } = view.box;
  const [ax, ay] = view.toScreen(view.extent.x_min, view.extent.y_min);
  const [bx, by] = view.toScreen(view.extent.x_max, view.extent.y_max);
  const wide = Math.min(Math.max(ax, bx), left + width) - Math.max(Math.min(ax, bx), left);
  const high = Math.min(Math.max(ay, by), top + height) - Math.max(Math.min(ay, by), top);
  return Math.max(wide, 1) * Math.max(high, 1);
}

function radius(count: number): number {
  return Math.min(7 + Math.log2(count), LARGEST);
}

/** Draw a disc, or for alarms of picture B a diamond, with the number of alarms; with a hit among them it has a second ring. */
export function drawGroup(pen: Pen, x: number, y: number, labels: string[], second = false): void {
  if (labels.length === 1) return drawAlarm(pen, x, y, labels[0]!, 5, second);
  const hit = labels.includes("detection");
  const plain = labels.every((label) => label === "false") ? "false" : "plain";
  const ink = INK[hit ? "detection" : plain]!;
  const r = radius(labels.length);
  const outline = (size: number, stroke: string, width: number, fill?: string): void => {
    const style = { stroke, width, ...(fill && { fill }) };
    const d = size * 1.2;
    if (second) pen.path([[x, y - d], [x + d, y], [x, y + d], [x - d, y]], true, style);
    else pen.ellipse(x, y, size, size, style);
  };
  outline(r, SHADOW, 4);
  outline(r, ink, 1.8, "#26313d");
  if (hit) outline(r + 3, ink, 1.4);
  const words = labels.length < 1000 ? String(labels.length) : `${Math.round(labels.length / 1000)}k`;
  pen.text(x, y + 4, words, { fill: "#ffffff", size: words.length > 2 ? 10 : 11, anchor: "middle", bold: true });
}

/** The group under the pointer. */
export function groupAt(groups: Group[], px: number, py: number): Group | null {
  const reaches = ({ px: x, py: y, rows }: Group): boolean => Math.hypot(x - px, y - py) <= radius(rows.length) + 3;
  return groups.find(reaches) ?? null;
}
