import { getJson } from "./data";
import { el, fixed, make } from "./dom";
import type { Lane } from "./types";

interface Event {
  event?: string;
  scan?: number;
  pose?: number[];
  alarm_id?: string;
  x?: number;
  y?: number;
  confidence?: number;
  latency_ms?: number;
  lane?: Lane;
  title?: string;
}
interface Answer { events: Event[]; next: number; bad: number; restarted: boolean }
export interface LiveAlarm { id: string; x: number; y: number; confidence: number }

const number = (value: unknown): value is number => typeof value === "number" && Number.isFinite(value);

/** Follows live.jsonl: `start`, `scan` with a pose, `alarm` and `end` events; what it does not know it leaves alone. */
export class Live {
  readonly track: { x: number; y: number; heading: number }[] = [];
  readonly alarms: LiveAlarm[] = [];
  lane: Lane | null = null;
  private offset = 0;
  private scans = 0;
  private bad = 0;
  private latency: number[] = [];
  private ended = false;
  private title = "";

  constructor(private readonly changed: (first: boolean) => void) {}

  start(): void {
    el("live").hidden = false;
    void this.poll();
  }

  /** Ground distance from the vehicle to an alarm along its heading, m; negative once it is passed. */
  distance(alarm: LiveAlarm): number | null {
    const here = this.track[this.track.length - 1];
    if (!here) return null;
    return (alarm.x - here.x) * Math.sin(here.heading) + (alarm.y - here.y) * Math.cos(here.heading);
  }

  private async poll(): Promise<void> {
    try {
      const answer = await getJson<Answer>(`data/live?after=${this.offset}`);
      if (answer.restarted) {
        this.track.length = this.alarms.length = this.latency.length = 0;
        this.scans = this.bad = 0;
        this.ended = false;
      }
      this.offset = answer.next;
      this.bad += answer.bad;
      const first = this.lane === null;
      for (const event of answer.events) this.take(event);
      if (answer.events.length || answer.restarted) {
        this.report();
        this.changed(first && this.lane !== null);
      }
      if (answer.events.length > 5000) return void this.poll();
    } catch {
      el("live").textContent = "Live: the server does not answer.";
    }
    setTimeout(() => void this.poll(), document.hidden ? 2000 : 400);
  }

  private take(event: Event): void {
    if (event.event === "start") {
      this.title = String(event.title ?? "");
      const lane = event.lane;
      if (lane && [lane.x_min, lane.x_max, lane.y_min, lane.y_max].every(number)) this.lane = lane;
    } else if (event.event === "scan") {
      this.scans++;
      const [x, y, , heading] = event.pose ?? [];
      if (number(x) && number(y)) this.track.push({ x, y, heading: number(heading) ? heading : 0 });
    } else if (event.event === "alarm" && number(event.x) && number(event.y)) {
      const alarm = { id: String(event.alarm_id ?? `live-${this.alarms.length + 1}`), x: event.x, y: event.y, confidence: number(event.confidence) ? event.confidence : 0 };
      const known = this.alarms.findIndex((one) => one.id === alarm.id);
      if (known >= 0) this.alarms[known] = alarm;
      else this.alarms.push(alarm);
      if (number(event.latency_ms)) this.latency.push(event.latency_ms);
    } else if (event.event === "end") this.ended = true;
    else this.bad++;
  }

  private report(): void {
    const sorted = [...this.latency].sort((a, b) => a - b);
    const late = sorted.length ? `, ${fixed(sorted[Math.min(Math.floor(0.95 * sorted.length), sorted.length - 1)]!, 0)} ms at the 95th percentile` : "";
    const here = this.track[this.track.length - 1];
    const words = `${this.scans} scans, ${this.alarms.length} alarms${late}${here ? `; vehicle at y ${fixed(here.y, 1)} m` : ""}${this.bad ? `; ${this.bad} lines not understood` : ""}${this.ended ? "; ended" : ""}`;
    const ahead = this.alarms
      .map((alarm) => ({ alarm, left: this.distance(alarm) }))
      .filter((one): one is { alarm: LiveAlarm; left: number } => one.left !== null && one.left > 0)
      .sort((a, b) => a.left - b.left)
      .slice(0, 8);
    const list = make("ul", { "aria-label": "Alarms ahead" });
    for (const { alarm, left } of ahead)
      list.append(make("li", {}, make("b", {}, `${fixed(left, 1)} m`), ` ahead: ${alarm.id}, x ${fixed(alarm.x, 2)} m, confidence ${fixed(alarm.confidence, 2)}`));
    el("live").replaceChildren(make("h2", {}, `Live ${this.title}`), make("p", { id: "live-words" }, words), list);
  }
}
