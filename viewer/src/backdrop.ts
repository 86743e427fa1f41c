import type { View } from "./view";

/** A map below the lane: x_min, x_max, y_min, y_max, m. */
export interface Backdrop { image: HTMLImageElement; box: [number, number, number, number] }

export function loadBackdrop(box: Backdrop["box"], loaded: () => void): Backdrop {
  const image = new Image();
  image.addEventListener("load", loaded);
  image.src = "data/backdrop.png";
  return { image, box };
}

/** Draw the map where it lies, whichever way the picture is turned, under everything else. */
export function drawBackdrop(context: CanvasRenderingContext2D, view: View, backdrop: Backdrop | null): void {
  if (!backdrop?.image.naturalWidth) return;
  const { image, box } = backdrop;
  const [x0, x1, y0, y1] = box;
  const [[ox, oy], [rx, ry], [dx, dy]] = [view.toScreen(x0, y1), view.toScreen(x1, y1), view.toScreen(x0, y0)];
  const [wide, high] = [image.naturalWidth, image.naturalHeight];
  const { left, top, width, height } = view.box;
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.transform((rx - ox) / wide, (ry - oy) / wide, (dx - ox) / high, (dy - oy) / high, ox, oy);
  context.drawImage(image, 0, 0);
  context.restore();
}
