import { colour, el, fitted } from "./dom";
import { labelOf } from "./overlay";
import type { Shown } from "./page";
import type { Box } from "./view";

/** Draw the whole lane with its alarms and what of it is in sight. */
export function drawOverview(app: Shown): void {
  const canvas = el<HTMLCanvasElement>("overview");
  const { context, width, height } = fitted(canvas);
  const box: Box = { left: app.view.box.left, top: 4, width: Math.max(width - app.view.box.left - 52, 10), height: height - 8 };
  context.clearRect(0, 0, width, height);
  context.fillStyle = colour("unseen");
  context.fillRect(box.left, box.top, box.width, box.height);
  app.picture.overview(context, app.compare === "blink" && app.flipped ? app.b : app.a, box);
  const { extent } = app.view;
  const scale = box.width / app.view.length;
  const rows = app.detection && app.show.alarms ? app.detection.alarms : null;
  rows?.y.forEach((y, row) => {
    if (!app.visible(row)) return;
    context.fillStyle = labelOf(app.source, app.detection, row) === "false" ? "#ffb84d" : "#7fd4ff";
    context.fillRect(box.left + (y - extent.y_min) * scale - 0.75, box.top + box.height - 5, 1.5, 5);
  });
  const [low, high] = app.view.span();
  const from = box.left + Math.max((low - extent.y_min) * scale, 0);
  const to = box.left + Math.min((high - extent.y_min) * scale, box.width);
  context.lineWidth = 2;
  context.strokeStyle = "#ffe45c";
  context.strokeRect(from + 1, box.top - 1, Math.max(to - from - 2, 3), box.height + 2);
}

/** Bring what a place of the overview shows into sight. */
export function overviewTo(app: Shown, px: number): void {
  const canvas = el<HTMLCanvasElement>("overview");
  const width = Math.max(canvas.clientWidth - app.view.box.left - 52, 10);
  app.view.y = app.view.extent.y_min + ((px - app.view.box.left) / width) * app.view.length;
  app.moved();
}
