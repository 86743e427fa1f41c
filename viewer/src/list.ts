import { digits, el, fixed, make } from "./dom";
import { labelOf } from "./overlay";
import { SHORT } from "./symbols";
import type { Detection, Note, Source } from "./types";

const PAGE = 200;

export interface ListState {
  source: Source;
  detection: Detection | undefined;
  rows: number[];
  selected: number | null;
  ticked: Set<number>;
  note: (row: number) => Note;
}

/** The alarms shown, by falling confidence. */
export class AlarmList {
  private most = PAGE;
  private state: ListState | null = null;

  constructor(
    private readonly choose: (row: number) => void,
    private readonly tick: (rows: number[], on: boolean) => void,
  ) {
    const head = ["", "alarm", "confid.", "x, m", "y, m", "as", "verdict"].map((name) => make("th", { scope: "col" }, name));
    document.querySelector("#list thead")!.append(make("tr", {}, ...head));
    el<HTMLInputElement>("tick-all").addEventListener("change", (event) => {
      if (this.state) this.tick(this.state.rows, (event.target as HTMLInputElement).checked);
    });
  }

  show(state: ListState): void {
    this.state = state;
    const { detection, rows, selected, ticked, source } = state;
    el("list-title").textContent = detection ? `Alarms (${rows.length} of ${detection.alarms.x.length})` : "Alarms";
    const all = el<HTMLInputElement>("tick-all");
    all.checked = rows.length > 0 && rows.every((row) => ticked.has(row));
    all.indeterminate = !all.checked && rows.some((row) => ticked.has(row));
    const body = el("rows");
    body.replaceChildren();
    if (!detection) return;
    const place = selected === null ? -1 : rows.indexOf(selected);
    if (place >= this.most) this.most = Math.ceil((place + 1) / PAGE) * PAGE;
    for (const row of rows.slice(0, this.most)) body.append(this.row(source, detection, row, row === selected, ticked.has(row)));
    if (rows.length > this.most) {
      const more = make("button", { type: "button" }, `show ${Math.min(PAGE, rows.length - this.most)} more`);
      more.addEventListener("click", () => {
        this.most += PAGE;
        this.show(state);
      });
      body.append(make("tr", { class: "more" }, make("td", { colspan: "7" }, more)));
    }
    const current = body.querySelector<HTMLElement>('[aria-selected="true"]');
    current?.scrollIntoView({ block: "nearest" });
  }

  private row(source: Source, detection: Detection, row: number, selected: boolean, ticked: boolean): HTMLElement {
    const { alarms } = detection;
    const label = labelOf(source, detection, row);
    const { verdict, text } = this.state!.note(row);
    const name = alarms.alarm_id?.[row] ?? `alarm-${row + 1}`;
    const box = make("input", { type: "checkbox", "aria-label": `select ${name} for export` });
    box.checked = ticked;
    box.addEventListener("click", (event) => event.stopPropagation());
    box.addEventListener("change", () => this.tick([row], box.checked));
    const button = make("button", { type: "button" }, name);
    const line = make(
      "tr",
      { "aria-selected": String(selected), "data-row": String(row) },
      make("td", {}, box),
      make("td", {}, button),
      make("td", {}, digits(alarms.confidence[row], 4)),
      make("td", {}, fixed(alarms.x[row]!, 2)),
      make("td", {}, fixed(alarms.y[row]!, 2)),
      make("td", { class: label }, SHORT[label] ?? label),
      make("td", { title: text }, verdict + (text ? " ✎" : "")),
    );
    line.addEventListener("click", () => this.choose(row));
    return line;
  }
}
