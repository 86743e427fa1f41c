/** Scans that a live run can be gone back to, and how many more are held, whose rows of the run-view those scans still need. */
const REACH = 5000;
const RESERVE = 500;

/** What is known of an alarm of a live run. */
export interface LiveAlarm {
  id: string;
  x: number;
  y: number;
  confidence: number;
  magnitude: number | null;
  scans: number | null;
  final: boolean;
  /** Probability that it is a target, now and, with 80 %, after the next look; whether that is worth waiting for. */
  p: number | null;
  next: [number, number] | null;
  wait: boolean;
}

/** Rows of the run-view that a live run sends, as half-precision numbers. */
export interface LiveRows { row: number; rows: number; median: number; halves: Uint16Array }

/** What came with a scan of a live run: its pose, what became of alarms (null: withdrawn), and rows of the run-view. */
export interface Moment {
  scan: number;
  x: number;
  y: number;
  heading: number;
  time: number | null;
  changes: [id: string, alarm: LiveAlarm | null][];
  rows: LiveRows[];
  /** Alarms of before detection started anew, as they were known then. */
  past: ReadonlySet<string>;
}

/** The scans of a live run in the order in which they came, so that the page can go back to them. */
export class History {
  /** Alarms at the first moment that is held. */
  private readonly base = new Map<string, LiveAlarm>();
  private held: Moment[] = [];

  /** The moments that the page can go back to, the oldest first. */
  get moments(): readonly Moment[] {
    return this.held.length > REACH ? this.held.slice(-REACH) : this.held;
  }

  clear(): void {
    this.held = [];
    this.base.clear();
  }

  add(moment: Moment): void {
    this.held.push(moment);
    if (this.held.length <= REACH + 2 * RESERVE) return;
    for (const old of this.held.splice(0, RESERVE)) apply(this.base, old);
  }

  /** What changed an alarm belongs to the newest scan; before the first scan there is nothing to go back to. */
  changed(id: string, alarm: LiveAlarm | null): void {
    const last = this.held[this.held.length - 1];
    if (last) last.changes.push([id, alarm]);
    else if (alarm) this.base.set(id, alarm);
  }

  grew(rows: LiveRows): void {
    this.held[this.held.length - 1]?.rows.push(rows);
  }

  /** The alarms as they stood after a scan. */
  alarmsAt(moment: Moment): Map<string, LiveAlarm> {
    const alarms = new Map(this.base);
    for (const one of this.until(moment)) apply(alarms, one);
    return alarms;
  }

  /** The way up to a scan, since detection last started anew. */
  trackAt(moment: Moment): Moment[] {
    return this.until(moment).filter((one) => one.past === moment.past);
  }

  /** Rows of the run-view that came up to a scan and after it, the oldest first. */
  rowsAbout(moment: Moment): { before: LiveRows[]; after: LiveRows[] } {
    const before = this.until(moment);
    const after = this.held.slice(before.length);
    const rows = (moments: Moment[]): LiveRows[] => moments.flatMap((one) => one.rows);
    return { before: rows(before), after: rows(after) };
  }

  private until(moment: Moment): Moment[] {
    return this.held.slice(0, this.held.indexOf(moment) + 1);
  }
}

function apply(alarms: Map<string, LiveAlarm>, moment: Moment): void {
  for (const [id, alarm] of moment.changes) {
    if (alarm) alarms.set(id, alarm);
    else alarms.delete(id);
  }
}
