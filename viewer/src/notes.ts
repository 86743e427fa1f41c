import { el } from "./dom";
import { download } from "./exports";
import type { Detection, Note, Source, Verdict } from "./types";

const EMPTY: Note = { verdict: "", text: "" };
const STORE = "flgpr-notes";
const HEAD = { format: "flgpr-notes", version: 1 };
const PAUSE = 200;

/** A note with the alarm that it is on, as files hold it. */
interface Stored extends Note {
  result: string;
  result_sha256: string;
  detection: string;
  alarm_id: string;
  x: number | null;
  y: number | null;
}

const keyOf = (one: Stored): string => JSON.stringify([one.result_sha256 || one.result, one.detection, one.alarm_id]);

function placeOf(source: Source, detection: Detection, row: number): Stored {
  const { alarm_id, x, y } = detection.alarms;
  return { result: source.title, result_sha256: source.identity, detection: detection.name, alarm_id: alarm_id?.[row] ?? String(row), x: x[row] ?? null, y: y[row] ?? null, ...EMPTY };
}

/** Notes and verdicts: kept in this tab or, where the viewer was started with a file for them, in that file. */
export class Notes {
  private held = new Map<string, Stored>();
  private before = "";
  private timer: number | undefined;
  private unsaved = false;
  private sending = false;

  constructor(
    private readonly sources: Source[],
    private readonly file: string | null,
  ) {
    if (file) addEventListener("beforeunload", (event) => (this.unsaved || this.sending) && event.preventDefault());
  }

  /** Take what was kept; throws where the file cannot be read. */
  async open(): Promise<void> {
    let kept: unknown;
    try {
      kept = this.file ? await this.ask() : JSON.parse(sessionStorage.getItem(STORE) ?? "{}");
    } catch (error) {
      if (this.file) throw error;
    }
    const { sha256, notes } = (kept ?? {}) as { sha256?: string; notes?: Stored[] };
    this.before = sha256 ?? "";
    for (const one of notes ?? []) this.held.set(keyOf(one), one);
    if (this.file) this.tell(`verdicts are kept in ${this.file}`);
  }

  get(source: Source, detection: Detection, row: number): Note {
    return this.held.get(keyOf(placeOf(source, detection, row))) ?? EMPTY;
  }

  set(source: Source, detection: Detection, row: number, change: Partial<Note>): Note {
    const place = placeOf(source, detection, row);
    const note = { ...place, ...this.get(source, detection, row), ...change };
    if (note.verdict || note.text) this.held.set(keyOf(place), note);
    else this.held.delete(keyOf(place));
    this.keep();
    return note;
  }

  private keep(): void {
    if (!this.file) return sessionStorage.setItem(STORE, JSON.stringify({ notes: [...this.held.values()] }));
    this.unsaved = true;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.send(), PAUSE);
  }

  private async ask(body?: string): Promise<{ sha256: string; notes?: Stored[] }> {
    const answer = await fetch("data/verdicts.json", body === undefined ? {} : { method: "PUT", body, headers: { "content-type": "application/json" } });
    const content = (await answer.json().catch(() => ({}))) as { sha256: string; error?: string };
    if (!answer.ok) throw new Error(content.error ?? `verdicts are not saved: ${answer.status}`);
    return content;
  }

  /** Send all notes, one time after the other: each names the state of the file that it follows. */
  private async send(): Promise<void> {
    if (this.sending) return; // what is under way looks again when it is done
    this.sending = true;
    try {
      while (this.unsaved) {
        const notes = [...this.held.values()];
        this.unsaved = false;
        this.before = (await this.ask(JSON.stringify({ ...HEAD, before: this.before, notes }))).sha256;
        this.tell(`${notes.length} ${notes.length === 1 ? "note" : "notes"} saved in ${this.file}`);
      }
    } catch (error) {
      this.unsaved = true;
      this.tell((error as Error).message, true);
    }
    this.sending = false;
  }

  private tell(words: string, bad = false): void {
    el("notes-state").textContent = words;
    el("notes-state").classList.toggle("missed", bad);
  }

  save(): void {
    download("flgpr-notes.json", JSON.stringify({ ...HEAD, notes: [...this.held.values()] }, null, 1) + "\n", "application/json");
  }

  /** Take notes of a file over one's own; gives how many are on the results that are open. Throws where it holds none. */
  async load(file: File): Promise<number> {
    const content = JSON.parse(await file.text()) as { format?: string; notes?: unknown };
    if (content.format !== HEAD.format || !Array.isArray(content.notes)) throw new Error("no notes");
    let here = 0;
    const taken: Stored[] = [];
    for (const entry of content.notes as (Record<string, unknown> | null)[]) {
      if (!entry || typeof entry["alarm_id"] !== "string" || !entry["alarm_id"]) throw new Error("a note without its alarm");
      const text = (name: string): string => String(entry[name] ?? "");
      const place = (name: string): number | null => (Number.isFinite(entry[name]) && Math.abs(entry[name] as number) < 1e6 ? (entry[name] as number) : null);
      const source = this.sources.find((one) => (text("result_sha256") ? one.identity === text("result_sha256") : one.title === text("result")));
      here += source ? 1 : 0;
      const verdict = ["mine", "unsure", "clutter"].includes(text("verdict")) ? (text("verdict") as Verdict) : "";
      const one: Stored = { result: text("result"), result_sha256: source?.identity ?? text("result_sha256"), detection: text("detection"), alarm_id: text("alarm_id"), x: place("x"), y: place("y"), verdict, text: text("text").slice(0, 500) };
      taken.push(one);
    }
    for (const one of taken) this.held.set(keyOf(one), one);
    this.keep();
    return here;
  }
}
