import { getJson } from "./data";
import { el, fixed, make } from "./dom";
import { counts, instruct, type Instruction, type Numbers, type Place } from "./instruct";
import { History, type LiveAlarm, type LiveRows, type Moment } from "./history";
import type { Detection, Georeference, Grid, Lane } from "./types";
import { sentences } from "./words";

interface Event {
  event?: string;
  scan?: number;
  pose?: number[];
  arrived?: number;
  threshold?: number | null;
  outcome?: string;
  finding?: string;
  stop?: boolean;
  alarm_id?: string;
  state?: string;
  x?: number;
  y?: number;
  confidence?: number;
  magnitude?: number;
  scans?: number;
  left_m?: number;
  p?: number;
  next_p?: number[];
  wait?: boolean;
  latency_ms?: number;
  lane?: Lane | null;
  grid?: Omit<Grid, "ny"> | null;
  channel?: [string, string];
  georeference?: Georeference | null;
  vehicle?: { [name: string]: number | null | undefined };
  title?: string;
  row?: number;
  rows?: number;
  median_db?: number;
  halves?: string;
  words?: string | string[];
  unlike?: boolean;
  kind?: string;
  [count: string]: unknown;
}
interface Answer { events: Event[]; next: number; bad: number; restarted: boolean; more?: boolean; age?: number | null; now?: number }

const percent = (value: number): string => fixed(100 * value, 0);
/** What is known of an alarm's probability, in few words; empty where it has none. */
export function chances({ p, next }: LiveAlarm): string {
  if (p === null) return "";
  return `p ${percent(p)} %${next ? `, next ${percent(next[0])}–${percent(next[1])} %` : ""}`;
}
const percents = ({ p, next }: LiveAlarm): string => `${percent(p ?? 0)}${next ? ` → ${percent(next[0])}–${percent(next[1])}` : ""} %`;

const number = (value: unknown): value is number => typeof value === "number" && Number.isFinite(value);
const FAULTS: Record<string, string> = {
  out_of_order: "out of order",
  duplicate: "duplicate",
  late: "too late",
  still: "standing",
  corrupt: "corrupt",
  masked: "with missing sweeps",
  pose_filled: "with a pose filled in",
  pose_missing: "without a pose",
  implausible: "with a wrong position",
  held: "held back",
  restarts: "new beginnings elsewhere",
  clock: "with a wrong clock",
  without_earlier: "beside every earlier drive",
  refused: "refused",
  missing: "missing",
};
const LISTED = 8;
/** Alarms in the picture, the nearest ones, that tell their distance. */
export const LABELLED = 8;
/** Between two requests, ms; a browser makes it longer for a page in the background. */
const POLL = 200;
/** A request that hangs is given up after so long, ms. */
const PATIENCE = 2000;
const NUMBERS = ["reaction", "deceleration", "warning", "clearance", "width", "tyre", "front", "axle", "walk"] as const;
/** Looks at a place that an alarm needs, beyond the first: ground that fewer scans have seen is not yet searched. */
const LOOKS = 2;
/** The time between two updates that is reckoned with until the radar's rhythm is known, s. */
const UPDATE = 0.75;
const OLDEST = 3600; // s, that a scan may have waited to be read
/** Intervals from which a rhythm is known. */
export const FEW = 4;
/** Time over which the speed is measured, s, and how far apart two scans may lie for it. */
const [MEASURED, FARTHEST] = [0.9, 3];

/** Half floats of base64. */
export function halves(text: string): Uint16Array {
  const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  return new Uint16Array(bytes.buffer, 0, bytes.length >> 1);
}

/** What the page does with what came. */
export interface LiveHandlers {
  /** The run is known: its lane, run-view lattice, channel, tie to the Earth. */
  began: (live: Live) => void;
  /** Rows of the run-view. */
  rows: (rows: LiveRows) => void;
  /** All of a poll was taken in; the alarms that came first, with the state they have now. */
  changed: (fresh: LiveAlarm[]) => void;
}

/** Follows live.jsonl: `start`, `scan`, `view`, `alarm`, `counts`, `problem`, `anew`, `resume` and `end`; what it does not know it leaves alone. */
export class Live {
  track: { scan: number; x: number; y: number; heading: number; time: number | null }[] = [];
  alarms = new Map<string, LiveAlarm>();
  readonly history = new History();
  /** The scan that the page has gone back to; null shows what is known now. */
  at: Moment | null = null;
  lane: Lane | null = null;
  grid: Grid | null = null;
  channel: [string, string] = ["", ""];
  georeference: Georeference | null = null;
  /** The table of the vehicle, but for the threshold; null until the run has begun. */
  vehicle: Record<(typeof NUMBERS)[number], number> | null = null;
  /** Speed as stated, m/s. */
  stated: number | null = null;
  /** The one clock of the driver's picture and words: when the page last looked, ms. */
  moment = performance.now();
  title = "";
  /** On the page's clock, ms: the last answer, the last frame of the radar, the last scan that was of use, the last pose. */
  readonly came = { answer: performance.now(), frame: 0, use: 0, pose: 0 };
  /** Between the last frames, ms. */
  readonly rhythm: number[] = [];
  /** How long before the last answer detection gave a sign of life, s; null where there is no file of events. */
  age: number | null = null;
  /** From the arrival of the last scan to its alarms, ms. */
  delay = 0;
  /** How often the file of events was begun anew. */
  runs = 0;
  private clock: number | null = null; // the server's, s
  begun = false;
  ended = false;
  caughtUp = false;
  counts: Record<string, number> = {};
  /** What is said of ground that is unlike that of the model's training; empty where confidences hold. */
  unlike: string[] = [];
  /** What alarms are, where earlier drives are subtracted; else empty. */
  changes = "";
  private offset = 0;
  private scans = new Set<number>();
  private bad = 0;
  private problem = "";
  /** Since when and for how many scans in a row positions have been wrong, on the page's clock, ms; null while they are good. */
  wrong: { since: number; scans: number } | null = null;
  /** Names of what is wrong with the radar, as told so far. */
  readonly found = new Set<string>();
  /** What blinds the radar or hides where it is, until a scan is of use again; null: nothing does. */
  halted: string | null = null;
  /** Alarms of before detection started anew: where positions were others, so that none of them lies ahead. */
  private past: ReadonlySet<string> = new Set();
  private latency: number[] = [];

  constructor(private readonly handlers: LiveHandlers) {}

  start(): void {
    el("live").hidden = false;
    void this.poll();
  }

  get here(): { x: number; y: number; heading: number } | null {
    return this.track[this.track.length - 1] ?? null;
  }

  /** Speed over the last scans by their poses and arrivals, m/s; null where they do not tell. */
  get measured(): number | null {
    const last = this.track[this.track.length - 1];
    if (!last || last.time === null) return null;
    for (let i = this.track.length - 2; i >= 0; i--) {
      const { x, y, time } = this.track[i]!;
      if (time === null || last.time - time > FARTHEST) return null;
      if (last.time - time >= MEASURED) return Math.hypot(last.x - x, last.y - y) / (last.time - time);
    }
    return null;
  }

  get speed(): number | null {
    return this.measured ?? this.stated;
  }

  get front(): number {
    return this.vehicle?.front ?? 0;
  }

  get numbers(): Numbers | null {
    return this.vehicle && { ...this.vehicle, threshold: this.least };
  }

  /** Distance driven from the word to the stand, v·t + v²/(2·a), m. */
  get stopping(): number | null {
    const { speed, vehicle } = this;
    return speed === null || !vehicle ? null : speed * vehicle.reaction + speed ** 2 / (2 * vehicle.deceleration);
  }

  /** How far ahead of the vehicle's front ground has been searched, m; not positive where none is. */
  get sight(): number {
    const { grid, here, track } = this;
    const before = track[track.length - 1 - LOOKS];
    if (!grid?.ny || !here || !before) return 0;
    const reach = this.distance({ x: here.x, y: grid.y + (grid.ny - 0.5) * grid.dy }) ?? 0;
    return reach - Math.hypot(here.x - before.x, here.y - before.y) - this.driven;
  }

  /** How far the vehicle has driven since the last pose was taken, m. */
  get driven(): number {
    return ((this.speed ?? 0) * Math.max(this.moment - this.came.pose, 0)) / 1000;
  }

  /** The longest time between two updates of late, s. */
  get update(): number {
    return this.rhythm.length < FEW ? UPDATE : Math.max(...this.rhythm) / 1000;
  }

  /** Where the vehicle is now, straight on from the last pose. */
  get now(): { x: number; y: number; heading: number } | null {
    const { here, driven } = this;
    return here && { x: here.x + driven * Math.sin(here.heading), y: here.y + driven * Math.cos(here.heading), heading: here.heading };
  }

  /** Where alarms lie from where the vehicle is now; those of positions that hold no more are left out. */
  places(): Place[] {
    return this.here ? [...this.alarms.values()].filter(({ id }) => !this.past.has(id)).map((one) => this.place(one, this.driven)) : [];
  }

  private place(alarm: LiveAlarm, driven: number): Place {
    return { id: alarm.id, confidence: alarm.confidence, left: (this.distance(alarm) ?? 0) - driven, aside: this.aside(alarm) };
  }

  /** What would be told of an alarm alone, as of the last scan; null where it does not count. */
  advice(alarm: LiveAlarm): Instruction | null {
    const { numbers } = this;
    const place = this.place(alarm, 0);
    if (!numbers || !this.here || this.past.has(alarm.id) || !counts(numbers, place)) return null;
    return instruct(numbers, { blind: false, speed: this.speed, update: this.update, sight: Infinity, alarms: [place], before: "clear" });
  }

  /** Whether the vehicle must brake for an alarm. */
  urgent(alarm: LiveAlarm): boolean {
    const word = this.advice(alarm)?.word;
    return word === "brake" || word === "stop";
  }

  /** Ground distance from the vehicle's front to an alarm along its heading, m; negative once it is passed. */
  distance(alarm: { x: number; y: number }): number | null {
    const { here } = this;
    if (!here) return null;
    return (alarm.x - here.x) * Math.sin(here.heading) + (alarm.y - here.y) * Math.cos(here.heading) - this.front;
  }

  /** Ground distance across the heading, m, right positive. */
  aside(alarm: { x: number; y: number }): number {
    const { here } = this;
    return here ? (alarm.x - here.x) * Math.cos(here.heading) - (alarm.y - here.y) * Math.sin(here.heading) : alarm.x;
  }

  /** The run as it was known after a scan: this one in all else, threshold and settings of the vehicle included. */
  asOf(moment: Moment): Live {
    const { history } = this;
    const then = Object.create(this) as Live; // what it does not have of its own it takes from this one
    then.at = moment;
    then.track = history.trackAt(moment);
    then.alarms = history.alarmsAt(moment);
    then.past = moment.past;
    return then;
  }

  /** The alarms as the page shows those of a result. */
  detection(): Detection {
    const all = [...this.alarms.values()];
    const column = <T>(take: (alarm: LiveAlarm) => T): T[] => all.map(take);
    return {
      name: "live",
      title: this.title,
      alarms: { alarm_id: column((one) => one.id), x: column((one) => one.x), y: column((one) => one.y), confidence: column((one) => one.confidence) },
      features: { scans: column((one) => one.scans), magnitude: column((one) => one.magnitude), ...(all.some((one) => one.p !== null) ? { p: column((one) => one.p) } : {}) },
      contributions: null,
      training: null,
    };
  }

  private async poll(): Promise<void> {
    let again = POLL;
    try {
      const control = new AbortController();
      const patience = setTimeout(() => control.abort(), PATIENCE);
      const answer = await getJson<Answer>(`data/live?after=${this.offset}`, control.signal).finally(() => clearTimeout(patience));
      this.came.answer = performance.now();
      this.age = answer.age ?? null;
      this.clock = answer.now ?? null;
      if (answer.restarted) this.forget();
      this.offset = answer.next;
      this.bad += answer.bad;
      const fresh = new Map<string, LiveAlarm>();
      for (const event of answer.events) this.take(event, fresh);
      if (answer.events.length || answer.restarted) {
        this.handlers.changed(this.caughtUp && !answer.more ? [...fresh.keys()].flatMap((id) => this.alarms.get(id) ?? []) : []);
      }
      this.caughtUp ||= !answer.more;
      if (answer.more) again = 0;
    } catch (error) {
      el("live").textContent = `Live: the server does not answer (${(error as Error).message}).`;
    }
    setTimeout(() => void this.poll(), again);
  }

  private forget(): void {
    this.track.length = this.latency.length = 0;
    this.alarms.clear();
    this.scans.clear();
    this.bad = 0;
    this.counts = {};
    this.unlike = [];
    this.changes = "";
    this.problem = "";
    this.wrong = this.halted = null;
    this.found.clear();
    this.past = new Set();
    this.history.clear();
    this.ended = this.begun = false;
    this.runs++;
  }

  private take(event: Event, fresh: Map<string, LiveAlarm>): void {
    if (event.event === "scan" || event.event === "counts" || event.event === "problem") this.heard();
    if (event.event === "start") this.begin(event);
    else if (event.event === "scan") this.takeScan(event);
    else if (event.event === "view") this.takeView(event);
    else if (event.event === "alarm" && number(event.x) && number(event.y)) this.takeAlarm(event, event.x, event.y, fresh);
    else if (event.event === "counts" || event.event === "end") {
      for (const name of Object.keys(FAULTS)) if (number(event[name])) this.counts[name] = event[name];
      this.ended ||= event.event === "end";
    } else if (event.event === "problem") this.takeProblem(event);
    else if (event.event === "ground") this.unlike = event.unlike === true && Array.isArray(event.words) ? event.words.map(String) : [];
    else if (event.event === "anew") this.moved();
    else if (event.event === "resume") this.ended = false;
    else this.bad++;
  }

  private takeProblem(event: Event): void {
    this.problem = String(event.words ?? "");
    if (event.kind === "health") {
      const name = String(event.finding ?? "");
      if (event.stop === true) this.halted = name;
      else this.found.add(name);
    }
    if (event.kind === "pose") this.wrong = { since: this.wrong?.since ?? performance.now(), scans: (this.wrong?.scans ?? 0) + 1 };
  }

  /** Detection started anew elsewhere: way and alarms so far belong to positions that hold no more. */
  private moved(): void {
    this.wrong = null;
    this.track.length = 0;
    this.past = new Set([...this.past, ...this.alarms.keys()]);
  }

  private heard(): void {
    const now = performance.now();
    if (now - this.came.frame > 20 && this.came.frame) this.rhythm.push(now - this.came.frame);
    if (this.rhythm.length > 9) this.rhythm.shift();
    this.came.frame = now;
  }

  private begin(event: Event): void {
    this.title = String(event.title ?? "");
    this.begun = true;
    this.ended = false;
    const { lane, grid } = event;
    if (lane && [lane.x_min, lane.x_max, lane.y_min, lane.y_max].every(number)) this.lane = lane;
    if (grid && [grid.x, grid.y, grid.nx, grid.dx, grid.dy].every(number)) this.grid = { ...grid, ny: 0 };
    if (Array.isArray(event.channel)) this.channel = [String(event.channel[0]), String(event.channel[1])];
    this.georeference = event.georeference ?? null;
    this.changes = Array.isArray(event.notes) ? event.notes.map(String).join("; ") : "";
    const { vehicle = {} } = event;
    this.stated = number(vehicle["speed"]) ? vehicle["speed"] : null;
    const values = NUMBERS.map((name) => [name, vehicle[name]] as const);
    this.vehicle = values.every(([, value]) => number(value)) ? (Object.fromEntries(values) as Live["vehicle"]) : null;
    if (number(event.threshold)) this.wanted = this.least = event.threshold;
    this.handlers.began(this);
  }

  private takeScan(event: Event): void {
    const [x, y, , heading] = event.pose ?? [];
    if (!number(x) || !number(y)) return;
    this.wrong = null;
    if (event.outcome === "taken" || event.outcome === "warm-up") this.halted = null;
    const scan = number(event.scan) ? event.scan : this.track.length;
    this.scans.add(scan);
    const one = { scan, x, y, heading: number(heading) ? heading : 0, time: number(event.arrived) ? event.arrived : null };
    const at = this.track.findIndex((other) => other.scan >= scan);
    if (at < 0) this.track.push(one);
    else if (this.track[at]!.scan === scan) this.track[at] = one;
    else this.track.splice(at, 0, one);
    this.history.add({ ...one, changes: [], rows: [], past: this.past });
    if (number(event.latency_ms) && event.outcome === "taken") this.latency.push(event.latency_ms);
    if (event.outcome !== "late") this.came.use = performance.now();
    this.delay = number(event.latency_ms) ? event.latency_ms : 0;
    if (at >= 0) return;
    const waited = this.clock !== null && number(event.arrived) ? this.clock - event.arrived : -1; // s, until it was read
    const late = waited >= 0 && waited < OLDEST ? 1000 * waited : this.delay;
    this.came.pose = performance.now() - late;
  }

  private takeView(event: Event): void {
    const { row, rows, halves: text } = event;
    if (!this.grid || !number(row) || !number(rows) || row < 0 || typeof text !== "string") return;
    const values = halves(text);
    if (values.length !== rows * this.grid.nx) {
      this.bad++;
      return;
    }
    this.grid.ny = Math.max(this.grid.ny, row + rows);
    const grown = { row, rows, median: number(event.median_db) ? event.median_db : 0, halves: values };
    this.history.grew(grown);
    this.handlers.rows(grown);
  }

  private takeAlarm(event: Event, x: number, y: number, fresh: Map<string, LiveAlarm>): void {
    const id = String(event.alarm_id ?? `live-${this.alarms.size + 1}`);
    if (event.state === "withdrawn") {
      this.alarms.delete(id);
      this.history.changed(id, null);
      fresh.delete(id);
      return;
    }
    const alarm = {
      id,
      x,
      y,
      confidence: number(event.confidence) ? event.confidence : 0,
      magnitude: number(event.magnitude) ? event.magnitude : null,
      scans: number(event.scans) ? event.scans : null,
      final: event.state === "final",
      p: number(event.p) ? event.p : null,
      next: number(event.next_p?.[0]) && number(event.next_p[1]) ? ([event.next_p[0], event.next_p[1]] as [number, number]) : null,
      wait: event.wait === true,
    };
    if (!this.alarms.has(id)) fresh.set(id, alarm);
    this.alarms.set(id, alarm);
    this.history.changed(id, alarm);
    if (number(event.latency_ms) && !this.track.length) this.latency.push(event.latency_ms);
  }

  /** Alarms ahead of the vehicle that a threshold lets through, the nearest first. */
  ahead(least: number): { alarm: LiveAlarm; left: number }[] {
    return [...this.alarms.values()]
      .filter(({ id }) => !this.past.has(id))
      .map((alarm) => ({ alarm, left: this.distance(alarm) }))
      .filter((one): one is { alarm: LiveAlarm; left: number } => one.left !== null && one.left > 0 && one.alarm.confidence >= least)
      .sort((a, b) => a.left - b.left);
  }

  /** An alarm as it is said: where it lies from the vehicle. */
  words(alarm: LiveAlarm): string {
    const left = this.distance(alarm);
    const aside = this.aside(alarm);
    const place = left === null ? `at y ${fixed(alarm.y, 1)} m` : left > 0 ? `${fixed(left, 1)} metres ahead` : "passed";
    const late = this.urgent(alarm) ? ", brake" : "";
    const told = [`confidence ${fixed(alarm.confidence, 2)}`, chances(alarm), alarm.wait ? "worth another look" : ""].filter(Boolean).join(", ");
    return `${alarm.id}, ${place}, ${fixed(Math.abs(aside), 1)} metres ${aside < 0 ? "left" : "right"}${late}, ${told}`;
  }

  /** Alarms are shown from this confidence on; as the run was started with, until the page's threshold is moved. */
  least = -Infinity;
  wanted: number | null = null;
  labelled = LABELLED;

  report(): void {
    const sorted = [...this.latency].sort((a, b) => a - b);
    const late = sorted.length ? `, ${fixed(sorted[Math.min(Math.floor(0.95 * sorted.length), sorted.length - 1)]!, 0)} ms from scan to alarms at the 95th percentile` : "";
    const { here } = this;
    const missing = this.bad ? `; ${this.bad} lines not understood` : "";
    const words = `${this.scans.size} scans, ${this.alarms.size} alarms${late}${here ? `; vehicle at y ${fixed(here.y, 1)} m` : ""}${missing}${this.ended ? "; ended" : ""}`;
    const parts: (Node | string)[] = [make("h2", {}, `Live ${this.title}`), make("p", { id: "live-words" }, words)];
    if (this.at) parts.push(make("p", { id: "live-then" }, `Gone back to scan ${this.at.scan}: vehicle, alarms and run-view as they were then`));
    if (this.changes) parts.push(make("p", { id: "live-changes" }, make("em", {}, sentences([this.changes]))));
    const [unlike, ...differences] = this.unlike;
    if (unlike) parts.push(make("p", { id: "live-unlike", title: differences.join("; ") }, make("em", {}, `${unlike.charAt(0).toUpperCase()}${unlike.slice(1)}.`)));
    const { vehicle } = this;
    if (this.stopping !== null && vehicle) {
      const decide = `reaction ${fixed(vehicle.reaction, 1)} s, ${fixed(vehicle.deceleration, 1)} m/s², ${fixed(this.update, 1)} s between updates, ${fixed(vehicle.clearance, 1)} m kept, ${fixed(vehicle.width, 2)} m wide, rear axle ${fixed(vehicle.front + vehicle.axle, 1)} m behind the front`;
      parts.push(make("p", { class: "soft", id: "live-stopping", title: decide }, `Stopping distance ${fixed(this.stopping, 1)} m at ${fixed(3.6 * (this.speed ?? 0), 0)} km/h`));
    }
    const faults = Object.entries(FAULTS).flatMap(([name, what]) => (this.counts[name] ? [`${this.counts[name]} ${what}`] : []));
    if (faults.length) parts.push(make("p", { id: "live-faults", class: "soft", title: this.problem }, `Scans: ${faults.join(", ")}`));
    if (this.found.size) parts.push(make("p", { id: "live-health", class: "soft", title: this.problem }, `Radar: ${[...this.found].join(", ")}`));
    const all = this.ahead(this.least);
    const list = make("ul", { "aria-label": "Alarms ahead" });
    for (const { alarm, left } of all.slice(0, LISTED)) {
      const aside = this.aside(alarm);
      const far = `${fixed(Math.abs(aside), 1)} m ${aside < 0 ? "left" : "right"}`;
      const urgent = this.urgent(alarm);
      const stop = urgent ? [make("em", {}, " brake")] : [];
      const again = alarm.wait ? [make("small", { class: "again", title: "another look is worth waiting for" }, " wait")] : [];
      const told = alarm.p === null ? [fixed(alarm.confidence, 2)] : [make("small", { title: "probability now, and with 80 % after the next look" }, percents(alarm)), ...again];
      const place = make("span", {}, make("b", {}, `${fixed(left, 1)} m`), ` ahead: ${alarm.id}, ${far}`, ...stop);
      list.append(make("li", { class: urgent ? "late" : "", "aria-label": this.words(alarm) }, place, make("span", {}, ...told)));
    }
    if (all.length > LISTED) list.append(make("li", {}, `and ${all.length - LISTED} more`));
    parts.push(list);
    el("live").replaceChildren(...parts);
  }
}
