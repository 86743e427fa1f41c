import { fixed } from "./dom";
import { FEW, type Live } from "./live";

/** After what silence something is lost, ms; a slower radar has its rhythm. */
const SILENCE = 750;
const [BEATS, LONGEST] = [2.5, 5000];
/** Positions that stay wrong for so long, ms, or for two scans in a row, are told: a single one costs a scan, no more. */
const DOUBT = 400;
/** Scans that are shown later than this after they came are told as late, ms. */
const BEHIND = 1000;
/** What the driver is told where a radar sees nothing, or nobody knows where it is, and what to do. */
const HALTED: Record<string, readonly [string, string]> = {
  "no positions": ["No positions", "check the GPS"],
  "frozen positions": ["Positions frozen", "check the GPS"],
  "repeated scans": ["Radar frozen", "start it again"],
  noise: ["Radar blind", "check the transmitter"],
};

export interface Health { level: "ok" | "wait" | "lost" | "slow" | "over"; words: string; detail: string }

/** Whether anything still comes, from the page's own clock: the first thing that is wrong on the way from the radar. */
export function health(live: Live, now: number): Health {
  const { came, age } = live;
  const lost = (words: string, silence: number): Health => ({ level: "lost", words, detail: `for ${fixed(silence / 1000, 1)} s` });
  const unheard = now - came.answer;
  if (unheard > SILENCE) return lost("No connection", unheard);
  if (live.ended) return { level: "over", words: "Run ended", detail: "no scan comes any more" };
  if (age === null) return { level: "wait", words: "Waiting", detail: "for detection to begin" };
  const still = 1000 * age + unheard;
  if (still > SILENCE) return live.begun ? lost("Detection stopped", still) : { level: "wait", words: "Waiting", detail: "for detection: it loads, or does not run" };
  if (!live.begun) return { level: "wait", words: "Waiting", detail: "for the first scan" };
  const sorted = [...live.rhythm].sort((a, b) => a - b);
  const rhythm = sorted.length < FEW ? 0 : sorted[sorted.length >> 1]!;
  const limit = Math.max(SILENCE, Math.min(BEATS * rhythm, LONGEST));
  if (now - came.frame > limit) return lost("No radar", now - came.frame);
  const { wrong } = live;
  if (wrong && (wrong.scans > 1 || now - wrong.since > DOUBT)) return { level: "lost", words: "Positions wrong", detail: "check the GPS" };
  if (live.halted !== null) {
    const [words, detail] = HALTED[live.halted] ?? ["Radar at fault", "check it"];
    return { level: "lost", words, detail };
  }
  if (now - came.use > limit) return lost("Scans unusable", now - came.use);
  if (live.delay > BEHIND) return { level: "slow", words: "Too slow", detail: `${fixed(live.delay / 1000, 1)} s late` };
  return { level: "ok", words: "", detail: "" };
}
