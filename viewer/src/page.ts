import type { Colours } from "./colour";
import type { Tiles } from "./data";
import type { Moment } from "./history";
import type { Picture } from "./lane";
import type { Live } from "./live";
import type { Choice, Compare, Detection, Source } from "./types";
import type { View } from "./view";

/** What the picture shows, as the modules see it that draw parts of it or put it into words. */
export interface Shown {
  readonly sources: Source[];
  /** The source that choice A is of. */
  readonly source: Source;
  readonly detection: Detection | undefined;
  readonly view: View;
  readonly picture: Picture;
  a: Choice;
  b: Choice;
  compare: Compare;
  /** Whether blinking shows choice B now. */
  flipped: boolean;
  /** Where swiping divides the picture, from 0 to 1. */
  divide: number;
  smooth: boolean;
  show: { alarms: boolean; truth: boolean; scans: boolean };
  /** Whether an alarm is shown at the threshold. */
  visible(row: number): boolean;
  /** The view was moved. */
  moved(): void;
}

/**
 * The application, as its parts see it that change what is shown.
 *
 * The application holds these parts, so that they know it by this interface only.
 */
export interface Page extends Shown {
  readonly tiles: Tiles;
  readonly following: { goTo(now: Live, moment: Moment | null): void };
  readonly scrub: { refresh(): void };
  colours: Colours;
  live: Live | null;
  /** The live run as it was after the scan that the page has gone back to. */
  past: Live | null;
  raw: { markScan(scan: number): void } | null;
  scan: number | null;
  thresholds: (number | null)[];
  readonly threshold: number | null;
  /** The threshold's place among the thresholds. */
  row: number;
  selected: number | null;
  ticked: Set<number>;
  evidence: { key: string };
  fitting: boolean;
  /** Whether the driver's screen is shown. */
  driving: boolean;
  markScan(scan: number | null): void;
  detectionChanged(): void;
  showChoices(): void;
  showAlarm(): void;
  showThreshold(): void;
  resized(): void;
  redraw(): void;
  say(words: string): void;
}
