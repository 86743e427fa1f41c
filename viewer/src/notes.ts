import { download } from "./exports";
import type { Note, Source, Verdict } from "./types";

const EMPTY: Note = { verdict: "", text: "" };
const STORE = "flgpr-notes";
const FORMAT = "flgpr-notes";

/** Notes and verdicts, kept in this tab until they are saved as a file: the server takes nothing. */
export class Notes {
  private held: Map<string, Note>;

  constructor(private readonly sources: Source[]) {
    try {
      this.held = new Map(JSON.parse(sessionStorage.getItem(STORE) ?? "[]") as [string, Note][]);
    } catch {
      this.held = new Map();
    }
  }

  get(key: string): Note {
    return this.held.get(key) ?? EMPTY;
  }

  set(key: string, change: Partial<Note>): Note {
    const note = { ...this.get(key), ...change };
    if (note.verdict || note.text) this.held.set(key, note);
    else this.held.delete(key);
    this.keep();
    return note;
  }

  private keep(): void {
    sessionStorage.setItem(STORE, JSON.stringify([...this.held]));
  }

  save(): void {
    const notes = [...this.held].map(([key, note]) => {
      const [result, detection, alarm_id] = key.split("|");
      const source = this.sources.find((one) => one.title === result);
      const found = source?.index.detections.find((one) => one.name === detection);
      const row = found?.alarms.alarm_id?.indexOf(alarm_id ?? "") ?? -1;
      return { result, detection, alarm_id, x: found?.alarms.x[row] ?? null, y: found?.alarms.y[row] ?? null, ...note };
    });
    download("flgpr-notes.json", JSON.stringify({ format: FORMAT, version: 1, notes }, null, 1) + "\n", "application/json");
  }

  /** Take notes of a file; throws where it holds none. */
  async load(file: File): Promise<number> {
    const content = JSON.parse(await file.text()) as { format?: string; notes?: unknown };
    if (content.format !== FORMAT || !Array.isArray(content.notes)) throw new Error("no notes");
    for (const entry of content.notes as Record<string, unknown>[]) {
      const verdict = ["mine", "unsure", "clutter"].includes(String(entry["verdict"])) ? (entry["verdict"] as Verdict) : "";
      const key = `${entry["result"]}|${entry["detection"]}|${entry["alarm_id"]}`;
      this.held.set(key, { verdict, text: String(entry["text"] ?? "").slice(0, 500) });
    }
    this.keep();
    return content.notes.length;
  }
}
