import { el } from "./dom";
import type { Live } from "./live";

/** What the driver found at an alarm goes into the log of the run, where the viewer was started so that it may. */
export class Answers {
  /** The alarm that a button would be about, with the distance to it. */
  private about: { id: string; left: number } | null = null;
  private given = new Map<string, string>();

  constructor(
    private readonly live: Live,
    private readonly allowed: boolean,
  ) {
    el("drive-answers").hidden = !allowed;
    el("drive-saw").addEventListener("click", () => void this.send("saw it"));
    el("drive-nothing").addEventListener("click", () => void this.send("nothing there"));
  }

  /** Offer an answer to an alarm; where none is ahead, to the last one. */
  offer(next: { id: string; left: number } | null): void {
    if (!this.allowed) return;
    if (next) this.about = next;
    if (this.about && !this.live.alarms.has(this.about.id)) this.about = null;
    for (const id of ["drive-saw", "drive-nothing"]) el<HTMLButtonElement>(id).disabled = !this.about;
    const { about } = this;
    const given = about && this.given.get(about.id);
    this.tell(about && given ? `${about.id}: ${given}` : "");
  }

  private tell(words: string): void {
    if (el("drive-answered").textContent !== words) el("drive-answered").textContent = words;
  }

  private async send(answer: string): Promise<void> {
    const { about, live } = this;
    const alarm = about && live.alarms.get(about.id);
    const scan = live.track[live.track.length - 1]?.scan;
    if (!about || !alarm || scan === undefined) return;
    this.given.set(about.id, "…");
    try {
      const body = JSON.stringify({ alarm_id: about.id, answer, x: alarm.x, y: alarm.y, left_m: Math.round(1000 * about.left) / 1000, scan });
      const reply = await fetch("data/answers", { method: "PUT", body });
      const content = (await reply.json().catch(() => null)) as { error?: string } | null;
      if (!reply.ok) throw new Error(content?.error ?? `status ${reply.status}`);
      this.given.set(about.id, `${answer}, noted`);
    } catch (error) {
      this.given.set(about.id, `NOT noted: ${(error as Error).message}`);
    }
    this.offer(null);
  }
}
