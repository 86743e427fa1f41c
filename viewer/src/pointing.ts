import type { App } from "./app";
import { el } from "./dom";
import { hitTest } from "./overlay";
import { overviewTo } from "./overview";
import { readout, unseenWords } from "./words";

/** How much nearer a click on a group of alarms brings it. */
const CLOSER = 3;

/** Say what lies under a place of the picture. */
function point(app: App, px: number, py: number): void {
  const { box } = app.view;
  const tip = el("tip");
  if (px < box.left || px > box.left + box.width || py < box.top || py > box.top + box.height) {
    el("readout").textContent = "";
    tip.hidden = true;
    return;
  }
  const [x, y] = app.view.toLane(px, py);
  el("readout").textContent = readout(app, x, y);
  const words = hitTest(app.view, app.overlay(), px, py)?.words ?? unseenWords(app, x, y);
  tip.hidden = !words;
  if (words) {
    tip.textContent = words;
    const right = px > box.left + box.width * 0.7;
    tip.style.left = right ? "" : `${px + 14}px`;
    tip.style.right = right ? `${el("stage").clientWidth - px + 14}px` : "";
    tip.style.top = `${Math.min(py + 12, box.top + box.height - 44)}px`;
  }
}

/** Choose what lies at a place of the picture, or bring a group of alarms nearer. */
function choose(app: App, px: number, py: number): void {
  const hit = hitTest(app.view, app.overlay(), px, py);
  if (hit?.kind === "alarm") app.select(hit.row);
  else if (hit?.kind === "group") {
    app.view.zoom(CLOSER, px, py);
    app.moved();
  } else if (hit?.kind === "scan") app.raw?.markScan(hit.row);
  else app.say(unseenWords(app, ...app.view.toLane(px, py)));
  point(app, px, py); // a finger hovers over nothing
}

/** Dragging, wheel and clicks move, zoom and choose, on the picture and on the overview. */
export function listenToPointer(app: App): void {
  const canvas = el<HTMLCanvasElement>("lane");
  let held: { x: number; y: number; moved: boolean; dividing: boolean } | null = null;
  const place = (event: MouseEvent): [number, number] => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / app.enlarged, (event.clientY - box.top) / app.enlarged];
  };
  const onLine = (px: number, py: number): boolean => {
    if (app.compare !== "swipe") return false;
    const { left, top, width, height } = app.view.box;
    return app.view.turned ? Math.abs(py - top - height * app.divide) < 7 : Math.abs(px - left - width * app.divide) < 7;
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    const [x, y] = place(event);
    held = { x, y, moved: false, dividing: onLine(x, y) };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    if (!held) {
      canvas.classList.toggle("dividing", onLine(x, y));
      point(app, x, y);
      return;
    }
    if (held.dividing) {
      const { left, top, width, height } = app.view.box;
      app.divide = Math.min(Math.max(app.view.turned ? (y - top) / height : (x - left) / width, 0), 1);
      app.redraw();
      return;
    }
    if (!held.moved && Math.hypot(x - held.x, y - held.y) < 4) return;
    canvas.classList.add("dragging");
    app.view.pan(x - held.x, y - held.y);
    held = { ...held, x, y, moved: true };
    app.moved();
  });
  const release = (event: PointerEvent): void => {
    canvas.classList.remove("dragging");
    if (held && !held.moved && !held.dividing && event.type === "pointerup") choose(app, ...place(event));
    held = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => point(app, -1, -1));
  canvas.addEventListener("dblclick", (event) => {
    app.view.zoom(2, ...place(event));
    app.moved();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) app.view.pan(-(event.deltaX || event.deltaY), 0);
    else app.view.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), ...place(event));
    app.moved();
  }, { passive: false });
  const overview = el<HTMLCanvasElement>("overview");
  const go = (event: PointerEvent): void => {
    if (event.buttons & 1) overviewTo(app, event.clientX - overview.getBoundingClientRect().left);
  };
  overview.addEventListener("pointerdown", (event) => {
    overview.setPointerCapture(event.pointerId);
    go(event);
  });
  overview.addEventListener("pointermove", go);
}
