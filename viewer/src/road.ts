import { colour } from "./dom";
import { counts, passed, type Instruction, type Numbers, type Place } from "./instruct";
import type { Pen, Point } from "./pen";
import type { Shown } from "./page";
import { rasters } from "./compare";

/** What the driver's picture and words are made of: all as of one moment. */
export interface Scene {
  numbers: Numbers;
  /** Width of a wheel, m. */
  tyre: number;
  pose: { x: number; y: number; heading: number };
  places: Place[];
  instruction: Instruction;
  /** How far ahead ground has been searched, m. */
  sight: number;
  /** Distance from the vehicle's front within which the driver is told to brake for an alarm, m; null without a speed. */
  braking: number | null;
}

/** Road in sight before and behind the vehicle, m, and beside what is kept free. */
const AHEAD = 15;
const BEHIND = 1;
const BESIDE = 0.4;
const MARK = 5;
/** Radius of an alarm, m, and the least of it in the picture's pixels. */
const [ALARM, LEAST] = [0.3, 7];
/** A wheel is that long, and an axle stands that far from the vehicle's end, m: only drawn. */
const [WHEEL, OVERHANG] = [0.8, 0.6];

/** Draw road, vehicle and alarms to scale; the vehicle points upwards, whatever its heading. */
export function drawRoad(app: Shown, context: CanvasRenderingContext2D, pen: Pen, density: number, scene: Scene): void {
  const { view } = app;
  const { numbers, pose, places, instruction } = scene;
  const { left, top, width, height } = view.box;
  const half = numbers.width / 2;
  const kept = half + numbers.clearance;
  const length = AHEAD + numbers.front + numbers.axle + OVERHANG + BEHIND;
  const scale = Math.min(height / length, width / (2 * (kept + BESIDE)));
  const middle = left + width / 2;
  const front = top + height - (numbers.front + numbers.axle + OVERHANG + BEHIND) * scale;
  const at = (aside: number, ahead: number): Point => [middle + aside * scale, front - ahead * scale];
  const box = (a: number, b: number, near: number, far: number): Point[] => [at(a, near), at(b, near), at(b, far), at(a, far)];
  const end = (front - top) / scale;

  Object.assign(view, { fill: false, scale, x: pose.x, y: pose.y });
  view.y -= (top + height / 2 - at(0, -numbers.front)[1]) / scale;
  context.save();
  const [px, py] = at(0, -numbers.front);
  context.translate(px, py);
  context.rotate(-pose.heading);
  context.translate(-px, -py);
  context.globalAlpha = 0.4;
  app.picture.striped = false;
  rasters(app, context, density);
  app.picture.striped = true;
  context.globalAlpha = 1;
  const { lane } = app.source.index;
  for (const x of [lane.x_min, lane.x_max]) pen.path([view.toScreen(x, lane.y_min), view.toScreen(x, lane.y_max)], false, { stroke: colour("ink"), width: 2 });
  context.restore();

  const track = colour("track");
  if (scene.sight < end) pen.path(box(-kept - BESIDE, kept + BESIDE, Math.max(scene.sight, 0), end), true, { fill: track, alpha: 0.35 });
  for (const side of [-1, 1]) {
    pen.path(box(side * half, side * (half - scene.tyre), 0, end), true, { fill: track, alpha: 0.3 });
    pen.path([at(side * kept, passed(numbers)), at(side * kept, end)], false, { stroke: track, width: 1.5, dash: [6, 5] });
  }
  if (scene.braking !== null && scene.braking < end) pen.path([at(-kept, scene.braking), at(kept, scene.braking)], false, { stroke: colour("brake"), width: 2.5 });
  for (let ahead = MARK; ahead < end; ahead += MARK) {
    const [edge, y] = at(kept, ahead);
    if (y < top + 12) break;
    pen.path([[edge, y], [edge + 6, y]], false, { stroke: colour("ink"), width: 1.5 });
    const hasRoom = edge + 44 < left + width;
    pen.text(hasRoom ? edge + 10 : left + width - 3, hasRoom ? y + 4 : y - 4, `${ahead} m`, { fill: colour("ink"), size: 11, anchor: hasRoom ? "start" : "end", halo: colour("road") });
  }
  const strong = places.filter(({ confidence }) => confidence >= numbers.threshold);
  for (const place of strong) if (!counts(numbers, place)) drawPlace(pen, at(place.aside, place.left), scale, null);
  drawBody(pen, box, scene);
  for (const place of strong) {
    if (!counts(numbers, place)) continue;
    const isNext = place.id === instruction.alarm?.id;
    drawPlace(pen, at(place.aside, place.left), scale, isNext && instruction.word !== "slow" ? "brake" : "slow");
  }
}

/** The vehicle: its outline from the front to behind the rear axle, and its wheels. */
function drawBody(pen: Pen, box: (a: number, b: number, near: number, far: number) => Point[], { numbers, tyre }: Scene): void {
  const half = numbers.width / 2;
  const rear = -(numbers.front + numbers.axle);
  const ink = colour("ink");
  pen.path(box(-half, half, rear - OVERHANG, 0), true, { stroke: ink, width: 2, fill: colour("body"), alpha: 0.8 });
  for (const axle of [-(OVERHANG + WHEEL / 2), rear])
    for (const side of [-1, 1]) pen.path(box(side * half, side * (half - tyre), axle - WHEEL / 2, axle + WHEEL / 2), true, { fill: ink });
}

/** An alarm: filled where it counts, a ring where it lies beside the way or has been passed. */
function drawPlace(pen: Pen, [x, y]: Point, scale: number, kind: "slow" | "brake" | null): void {
  const r = Math.max(ALARM * scale, LEAST);
  if (kind === null) return pen.ellipse(x, y, r * 0.7, r * 0.7, { stroke: colour("ink"), width: 1.5, alpha: 0.6 });
  pen.path([[x, y - 1.25 * r], [x + 1.25 * r, y], [x, y + 1.25 * r], [x - 1.25 * r, y]], true, { fill: colour(kind), stroke: colour("edge"), width: 2 });
}
