import { COLOUR_MAPS } from "./colormaps";
import type { App } from "./app";
import { el, make } from "./dom";

interface Key { keys: string[]; shown: string; words: string; act: (app: App, event: KeyboardEvent) => void }

const pan = (app: App, event: KeyboardEvent, x: number, y: number): void => {
  const far = event.shiftKey ? 0.9 : 0.15;
  app.view.pan(x * far * app.view.box.width, y * far * app.view.box.height);
  app.moved();
};
const end = (app: App, y: number): void => {
  app.view.y = y;
  app.moved();
};

export const KEYS: Key[] = [
  { keys: ["n", "N"], shown: "N", words: "next alarm by confidence", act: (app) => app.step(1) },
  { keys: ["p", "P"], shown: "P", words: "previous alarm", act: (app) => app.step(-1) },
  { keys: ["y"], shown: "Y", words: "verdict: mine", act: (app) => app.setNote({ verdict: "mine" }) },
  { keys: ["u"], shown: "U", words: "verdict: unsure", act: (app) => app.setNote({ verdict: "unsure" }) },
  { keys: ["r"], shown: "R", words: "verdict: clutter", act: (app) => app.setNote({ verdict: "clutter" }) },
  { keys: ["e"], shown: "E", words: "write a note", act: (app) => app.selected !== null && el("note").focus() },
  { keys: ["Escape"], shown: "Esc", words: "close the alarm", act: (app) => app.select(null) },
  { keys: [","], shown: ",", words: "higher threshold, fewer alarms", act: (app) => app.setThreshold(app.row - 1) },
  { keys: ["."], shown: ".", words: "lower threshold, more alarms", act: (app) => app.setThreshold(app.row + 1) },
  { keys: ["ArrowLeft"], shown: "← → ↑ ↓", words: "move; with Shift by a page", act: (app, event) => pan(app, event, 1, 0) },
  { keys: ["ArrowRight"], shown: "", words: "", act: (app, event) => pan(app, event, -1, 0) },
  { keys: ["ArrowUp"], shown: "", words: "", act: (app, event) => pan(app, event, 0, 1) },
  { keys: ["ArrowDown"], shown: "", words: "", act: (app, event) => pan(app, event, 0, -1) },
  { keys: ["Home"], shown: "Home End", words: "start and end of the lane", act: (app) => end(app, -Infinity) },
  { keys: ["End"], shown: "", words: "", act: (app) => end(app, Infinity) },
  { keys: ["+", "="], shown: "+ −", words: "zoom", act: (app) => app.zoom(1.5) },
  { keys: ["-", "_"], shown: "", words: "", act: (app) => app.zoom(1 / 1.5) },
  { keys: ["f"], shown: "F", words: "whole lane", act: (app) => app.fit() },
  { keys: ["i"], shown: "I", words: "true scale or stretched", act: (app) => app.trueScale() },
  { keys: ["o"], shown: "O", words: "turn the picture", act: (app) => app.turn() },
  { keys: ["l"], shown: "L", words: "follow the vehicle of a live run", act: (app) => app.live && app.following.set(!app.following.on) },
  { keys: ["h"], shown: "H J", words: "previous and next scan", act: (app) => app.scrub.step(-1) },
  { keys: ["j"], shown: "", words: "", act: (app) => app.scrub.step(1) },
  { keys: ["b"], shown: "B", words: "blink A and B", act: (app) => app.setCompare(app.compare === "blink" ? "off" : "blink") },
  { keys: ["s"], shown: "S", words: "swipe between A and B", act: (app) => app.setCompare(app.compare === "swipe" ? "off" : "swipe") },
  { keys: ["w"], shown: "W", words: "blink between today and the earlier drive", act: (app) => app.days() },
  { keys: ["x"], shown: "X", words: "flip A and B once", act: (app) => app.compare === "blink" && app.flip() },
  { keys: ["["], shown: "[ ]", words: "move the swipe line", act: (app) => divide(app, -0.04) },
  { keys: ["]"], shown: "", words: "", act: (app) => divide(app, 0.04) },
  { keys: ["v"], shown: "V", words: "next polarization", act: (app) => app.nextChannel("polarization") },
  { keys: ["g"], shown: "G", words: "next sub-band", act: (app) => app.nextChannel("subband") },
  { keys: ["c"], shown: "C", words: "next colour map", act: (app) => nextMap(app) },
  { keys: ["d"], shown: "D", words: "more dynamic range; Shift: less", act: (app) => app.setColours({ range: Math.min(app.colours.range + 5, 60) }) },
  { keys: ["D"], shown: "", words: "", act: (app) => app.setColours({ range: Math.max(app.colours.range - 5, 5) }) },
  { keys: ["k"], shown: "K", words: "higher floor; Shift: lower", act: (app) => app.setColours({ floor: Math.min(app.colours.floor + 2, 30) }) },
  { keys: ["K"], shown: "", words: "", act: (app) => app.setColours({ floor: Math.max(app.colours.floor - 2, -20) }) },
  { keys: ["t"], shown: "T", words: "light or dark", act: () => el("theme").click() },
  { keys: ["?"], shown: "?", words: "this list", act: () => el("help").click() },
];

function divide(app: App, by: number): void {
  app.divide = Math.min(Math.max(app.divide + by, 0), 1);
  app.redraw();
}

function nextMap(app: App): void {
  const names = Object.keys(COLOUR_MAPS);
  app.setColours({ map: names[(names.indexOf(app.colours.map) + 1) % names.length]! });
  app.say(`Colour map ${app.colours.map}`);
}

/** Keys work wherever no field takes them itself. */
export function listenToKeys(app: App): void {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || el<HTMLDialogElement>("keys").open) return;
    const target = event.target as HTMLElement;
    const input = target instanceof HTMLInputElement ? target.type : "";
    if (input === "text" && event.key === "Escape") return target.blur();
    if (input === "text" || input === "search" || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) return;
    const moving = event.key.startsWith("Arrow") || event.key === "Home" || event.key === "End";
    if (moving && (input || target.closest('[role="tablist"], .scroll, #explain, #patches, #scores, #raw-toml'))) return;
    const key = KEYS.find((one) => one.keys.includes(event.key)) ?? (event.shiftKey ? undefined : KEYS.find((one) => one.keys.includes(event.key.toLowerCase())));
    if (!key) return;
    event.preventDefault();
    key.act(app, event);
  });
}

export function fillHelp(): void {
  const dialog = el<HTMLDialogElement>("keys");
  const keys = make("div", { class: "keys" });
  for (const { shown, words } of KEYS) {
    if (!shown) continue;
    const caps = shown.split(" ").map((cap) => make("kbd", {}, cap));
    keys.append(make("div", {}, make("span", {}, ...caps), words));
  }
  const close = make("button", { type: "button" }, "Close");
  close.addEventListener("click", () => dialog.close());
  dialog.append(
    make("h2", {}, "Keyboard"),
    keys,
    make("h2", {}, "Picture"),
    make("p", {}, "Squares are metal targets, triangles plastic, diamonds simulants, hexagons others; the fuller, the deeper. Colours count dB above the median of the whole run-view, so that pictures before and after suppression compare. Drag or use the wheel to move and zoom; click an alarm to see why it was raised."),
    make("p", {}, "Notes and verdicts stay in this tab, or in the file of flgpr view --verdicts; Export saves them to a file of yours."),
    close,
  );
}
