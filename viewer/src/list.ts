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
  private current: HTMLElement | null = null;
  private readonly lines = new Map<string, HTMLTableRowElement>();

  constructor(
    private readonly choose: (row: number) => void,
    private readonly tick: (rows: number[], on: boolean) => void,
  ) {
    const ticks = make("th", { scope: "col" }, make("span", { class: "unseen" }, "for export"));
    const names = ["alarm", "confid.", "x, m", "y, m", "as", "verdict"].map((name) => make("th", { scope: "col" }, name));
    const head = [ticks, ...names];
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
    const place = selected === null ? -1 : rows.indexOf(selected);
    if (place >= this.most) this.most = Math.ceil((place + 1) / PAGE) * PAGE;
    const lines = detection ? rows.slice(0, this.most).map((row) => this.row(source, detection, row, row === selected, ticked.has(row))) : [];
    if (rows.length > this.most) lines.push(this.more(state, Math.min(PAGE, rows.length - this.most)));
    arrange(el("rows"), lines);
    const current = place < 0 ? null : lines[place]!;
    if (current && current !== this.current) reveal(current);
    this.current = current;
  }

  private more(state: ListState, count: number): HTMLElement {
    const more = make("button", { type: "button" }, `show ${count} more`);
    more.addEventListener("click", () => {
      this.most += PAGE;
      this.show(state);
    });
    return make("tr", { class: "more" }, make("td", { colspan: "7" }, more));
  }

  /** The line of an alarm: the same element as before, so that focus and clicks outlive the news of a live run. */
  private row(source: Source, detection: Detection, row: number, selected: boolean, ticked: boolean): HTMLElement {
    const { alarms } = detection;
    const name = alarms.alarm_id?.[row] ?? `alarm-${row + 1}`;
    const key = `${source.id}/${detection.name}/${name}`;
    const line = this.lines.get(key) ?? this.newLine(name);
    this.lines.set(key, line);
    const label = labelOf(source, detection, row);
    const { verdict, text } = this.state!.note(row);
    const values = [digits(alarms.confidence[row], 4), fixed(alarms.x[row]!, 2), fixed(alarms.y[row]!, 2), SHORT[label] ?? label, verdict + (text ? " ✎" : "")];
    values.forEach((value, i) => {
      const cell = line.cells[i + 2]!;
      if (cell.textContent !== value) cell.textContent = value;
    });
    line.cells[5]!.className = label;
    line.cells[6]!.title = text;
    line.dataset["row"] = String(row);
    line.setAttribute("aria-selected", String(selected));
    line.querySelector("input")!.checked = ticked;
    return line;
  }

  private newLine(name: string): HTMLTableRowElement {
    const box = make("input", { type: "checkbox", "aria-label": `select ${name} for export` });
    const line = make("tr", {}, make("td", {}, box), make("td", {}, make("button", { type: "button" }, name)));
    for (let i = 0; i < 5; i++) line.append(make("td", {}));
    const row = (): number => Number(line.dataset["row"]);
    box.addEventListener("click", (event) => event.stopPropagation());
    box.addEventListener("change", () => this.tick([row()], box.checked));
    line.addEventListener("click", () => this.choose(row()));
    return line;
  }
}

/** Scroll a line of the list into sight, and nothing but the list: the page may stand at the picture. */
function reveal(line: HTMLElement): void {
  const home = line.closest(".scroll")!;
  const [frame, own] = [home.getBoundingClientRect(), line.getBoundingClientRect()];
  const head = home.querySelector("thead")!.clientHeight;
  if (own.top < frame.top + head) home.scrollTop -= frame.top + head - own.top;
  else if (own.bottom > frame.bottom) home.scrollTop += own.bottom - frame.bottom;
}

/** Give an element these children, leaving alone those that are in their place. */
function arrange(home: HTMLElement, children: HTMLElement[]): void {
  const wanted = new Set<Element>(children);
  for (const child of [...home.children]) if (!wanted.has(child)) child.remove();
  let at = home.firstElementChild;
  for (const child of children) {
    if (child === at) at = at.nextElementSibling;
    else home.insertBefore(child, at);
  }
}
