/**
 * What the driver is told: one function of what is known, and of the numbers in the table of the vehicle.
 *
 * All that is slow on the way from the ground to the brakes is in it: `left` is where the vehicle is now, so that it has what
 * was driven since the scan was taken; `update` is how long until more may be known; `reaction` is the driver and the brakes.
 */

export type Word = "clear" | "slow" | "brake" | "stop" | "over";

/** The table of the vehicle (`flgpr.model.vehicle.Vehicle`): s, m/s², m and m/s. */
export interface Numbers {
  /** Confidence from which an alarm counts. */
  threshold: number;
  reaction: number;
  deceleration: number;
  warning: number;
  clearance: number;
  width: number;
  front: number;
  axle: number;
  walk: number;
}

/** Where an alarm lies from the middle of the vehicle's front, along and across its heading, m; right is positive. */
export interface Place { id: string; confidence: number; left: number; aside: number }

export interface Known {
  /** Nothing comes, or nobody knows where the vehicle is. */
  blind: boolean;
  /** m/s; null where nobody knows it. */
  speed: number | null;
  /** The longest time between two updates of late, s. */
  update: number;
  /** How far ahead of the vehicle's front an alarm would be known, m. */
  sight: number;
  alarms: readonly Place[];
  /** What the driver was told last. */
  before: Word;
}

export interface Instruction {
  word: Word;
  /** Whole km/h, of "slow" and "clear". */
  fastest: number | null;
  /** Until brakes must hold, of "brake"; until the rear axle is past, m, of "over". */
  left: number | null;
  /** The alarm that it is about. */
  alarm: Place | null;
}

/** Distance from the vehicle's front at which the rear axle has passed an alarm, m; negative. */
export function passed({ front, axle, clearance }: Numbers): number {
  return -(front + axle + clearance);
}

/** Whether an alarm counts: strong enough, in the way of the vehicle, and not yet behind its rear axle. */
export function counts(numbers: Numbers, { confidence, left, aside }: Place): boolean {
  return confidence >= numbers.threshold && Math.abs(aside) <= numbers.width / 2 + numbers.clearance && left > passed(numbers);
}

/** Distance from the brakes' hold to the stand, m. */
function braking({ deceleration }: Numbers, speed: number): number {
  return speed ** 2 / (2 * deceleration);
}

/** The speed from which the vehicle can be warned, told to brake and stopped before a distance, whole km/h. */
export function speedFor(numbers: Numbers, distance: number, update: number): number {
  const { deceleration: a, reaction, warning, clearance } = numbers;
  const time = warning + update + reaction;
  const room = Math.max(distance - clearance, 0);
  return Math.floor(3.6 * a * (Math.sqrt(time ** 2 + (2 * room) / a) - time) + 1e-9);
}

export function instruct(numbers: Numbers, known: Known): Instruction {
  const { update, before } = known;
  const speed = known.speed ?? Infinity; // a speed that nobody knows may be any
  if (known.blind) return { word: "stop", fastest: null, left: null, alarm: null };
  const inTheWay = known.alarms.filter((one) => counts(numbers, one)).sort((a, b) => a.left - b.left);
  const next = inTheWay.find(({ left }) => left > 0);
  const under = inTheWay.filter(({ left }) => left <= 0);
  const fastest = next ? speedFor(numbers, next.left, update) : null;
  if (next && fastest !== null) {
    const room = next.left - numbers.clearance - braking(numbers, speed);
    const seconds = speed > 0 ? room / speed : Infinity;
    if (fastest < 1 || !(seconds > 0)) return { word: "stop", fastest: null, left: next.left, alarm: next };
    const holds = before === "brake" && 3.6 * speed > fastest; // until the speed is one for the distance
    if (holds || seconds <= numbers.reaction + update) return { word: "brake", fastest: null, left: seconds, alarm: next };
  }
  const last = under[under.length - 1];
  if (last) return { word: "over", fastest: null, left: last.left - passed(numbers), alarm: last };
  if (next) return { word: "slow", fastest, left: null, alarm: next };
  const seen = known.sight > 0 ? speedFor(numbers, known.sight, update) : Math.floor(3.6 * numbers.walk + 1e-9);
  const isClear = known.sight > 0 && 3.6 * speed <= seen;
  return { word: isClear ? "clear" : "slow", fastest: seen, left: null, alarm: null };
}
