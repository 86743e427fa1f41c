import { HALF, layerOf } from "./data";
import { digits, fixed } from "./dom";
import { geographic } from "./geo";
import { labelOf } from "./overlay";
import type { Shown } from "./page";
import { LABELS } from "./symbols";
import type { Choice, Detection, Source } from "./types";

/** Notes as sentences. */
export const sentences = (notes: string[]): string => (Array.isArray(notes) ? notes : []).map((words) => String(words).replaceAll("`", "")).map((words) => `${words[0]?.toUpperCase() ?? ""}${words.slice(1)}.`).join(" ");

/** Words on lines of at most so many letters. */
export function wrapped(words: string, most: number): string[] {
  return words.split(" ").reduce<string[]>((lines, word) => {
    const longer = `${lines.at(-1) ?? ""} ${word}`.trim();
    return lines.length && longer.length <= most ? [...lines.slice(0, -1), longer] : [...lines, word];
  }, []);
}

/** An alarm as it is said. */
export function alarmWords(source: Source, detection: Detection, row: number): string {
  const { alarms } = detection;
  const label = labelOf(source, detection, row);
  const place = `${fixed(alarms.y[row]!, 2)} metres down-track, ${fixed(Math.abs(alarms.x[row]!), 2)} metres ${alarms.x[row]! < 0 ? "left" : "right"}`;
  return `${alarms.alarm_id?.[row] ?? "alarm"}, ${LABELS[label]}, confidence ${digits(alarms.confidence[row], 4)}, ${place}`;
}

/** Rank, confidence and, where the truth is known, what an alarm stands for. */
export function alarmFacts(source: Source, detection: Detection, row: number): string {
  const { alarms } = detection;
  const rank = [...alarms.confidence].filter((one) => one > alarms.confidence[row]!).length + 1;
  const scored = source.score?.detections[detection.name];
  const target = scored?.target[row] ?? -1;
  const truth = source.score?.truth;
  const label = labelOf(source, detection, row);
  const what = target >= 0 && truth ? `${label === "detection" ? "hit of" : "in the halo of"} ${truth.target_id[target]} (${truth.kind[target]}, ${fixed(100 * (truth.depth[target] ?? NaN), 1)} cm), ${fixed(scored?.distance[row] ?? NaN, 2)} m off` : label === "plain" ? "" : LABELS[label]!;
  return [`rank ${rank}`, `confidence ${digits(alarms.confidence[row], 4)}`, what].filter(Boolean).join(" · ");
}

/** Why no scan has seen the ground at a place; nothing where one has, or beside the picture. */
export function unseenWords(app: Shown, x: number, y: number): string {
  const { scans, sight } = app.source.index;
  if (!Number.isNaN(app.picture.value(app.a, x, y, HALF))) return "";
  const head = "seen by no scan";
  if (!sight || !scans.y.length) return head;
  const ahead = scans.y.map((sy, i) => (x - scans.x[i]!) * Math.sin(scans.heading[i]!) + (y - sy) * Math.cos(scans.heading[i]!));
  const looking = ahead.flatMap((distance, i) => (distance >= sight[0] && distance <= sight[1] ? [i] : []));
  const left = looking.filter((i) => scans.masked.includes(i));
  if (looking.length) return left.length === looking.length ? `${head}: ${left.length > 1 ? "scans" : "scan"} ${spans(left)} left out,\nsweeps are missing` : `${head}: beside what they image`;
  const before = ahead.lastIndexOf(Math.min(...ahead.filter((one) => one > sight[1])));
  const after = ahead.indexOf(Math.max(...ahead.filter((one) => one < sight[0])));
  if (before < 0) return `${head}: before the first one's sight,\nwhich begins ${digits(sight[0])} m ahead`;
  if (after < 0) return `${head}: beyond the last one's sight,\nwhich ends ${digits(sight[1])} m ahead`;
  return `${head}: gap in the track from scan ${before} to ${after},\ny ${fixed(scans.y[before]!, 2)} to ${fixed(scans.y[after]!, 2)} m`;
}

/** Rising numbers as spans: 3 to 5, 9. */
function spans(rows: number[]): string {
  const ends: [number, number][] = [];
  for (const row of rows) {
    const last = ends[ends.length - 1];
    if (last && last[1] === row - 1) last[1] = row;
    else ends.push([row, row]);
  }
  return ends.map(([a, b]) => (a === b ? `${a}` : `${a} to ${b}`)).join(", ");
}

/** What lies under the pointer. */
export function readout(app: Shown, x: number, y: number): string {
  const words = [`y ${fixed(y, 2)} m`, `x ${fixed(x, 2)} m`];
  const amplitude = (choice: Choice, name: string): void => {
    const source = app.sources[choice.source]!;
    const value = app.picture.value(choice, x, y, HALF);
    const median = layerOf(source, choice)?.percentiles["50"] ?? 0;
    if (value !== null && Number.isFinite(value)) words.push(`${name}${fixed(value - median, 1)} dB above median${choice.set === "before" ? "" : ` (${fixed(value, 1)} re background)`}`);
  };
  amplitude(app.a, app.compare === "off" ? "" : "A ");
  if (app.compare !== "off") amplitude(app.b, "B ");
  const { scans } = app.source.index;
  let best = -1;
  scans.y.forEach((sy, i) => {
    if (!scans.masked.includes(i) && sy < y && (best < 0 || sy > scans.y[best]!)) best = i;
  });
  if (best >= 0) words.push(`scan ${best}, range ${fixed(Math.hypot(x - scans.x[best]!, y - scans.y[best]!), 1)} m`);
  const place = geographic(app.source.index.georeference);
  if (place) {
    const [latitude, longitude] = place(x, y);
    words.push(`${latitude.toFixed(6)}°, ${longitude.toFixed(6)}°`);
  }
  return words.join("   ");
}
