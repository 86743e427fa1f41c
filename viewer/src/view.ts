import type { Lane } from "./types";

export interface Box { left: number; top: number; width: number; height: number }

/**
 * Where lane metres lie on the screen. Down-track runs to the right (right of the lane is below), or upwards when turned.
 * With `fill`, cross-track is stretched to the height there is until true scale fits: a lane is hundreds of times as long as wide.
 */
export class View {
  x = 0;
  y = 0;
  scale = 10;
  fill = false;
  turned = false;
  box: Box = { left: 0, top: 0, width: 1, height: 1 };

  constructor(public extent: Lane) {
    this.x = (extent.x_min + extent.x_max) / 2;
    this.y = (extent.y_min + extent.y_max) / 2;
  }

  get along(): number {
    return this.turned ? this.box.height : this.box.width;
  }

  get across(): number {
    return this.turned ? this.box.width : this.box.height;
  }

  get length(): number {
    return this.extent.y_max - this.extent.y_min;
  }

  get breadth(): number {
    return this.extent.x_max - this.extent.x_min;
  }

  /** Pixels per metre cross-track. */
  get scaleX(): number {
    return this.fill ? Math.max(this.scale, (0.96 * this.across) / this.breadth) : this.scale;
  }

  fit(): void {
    const along = (0.985 * this.along) / this.length;
    const across = (0.96 * this.across) / this.breadth;
    this.fill = along * 4 < across;
    this.scale = this.fill ? along : Math.min(along, across);
    this.x = (this.extent.x_min + this.extent.x_max) / 2;
    this.y = (this.extent.y_min + this.extent.y_max) / 2;
  }

  toScreen(x: number, y: number): [number, number] {
    const along = (y - this.y) * this.scale;
    const across = (x - this.x) * this.scaleX;
    const { left, top, width, height } = this.box;
    return this.turned
      ? [left + width / 2 + across, top + height / 2 - along]
      : [left + width / 2 + along, top + height / 2 + across];
  }

  toLane(px: number, py: number): [number, number] {
    const dx = px - this.box.left - this.box.width / 2;
    const dy = py - this.box.top - this.box.height / 2;
    return this.turned
      ? [this.x + dx / this.scaleX, this.y - dy / this.scale]
      : [this.x + dy / this.scaleX, this.y + dx / this.scale];
  }

  zoom(factor: number, px: number, py: number): void {
    const [x, y] = this.toLane(px, py);
    const least = Math.min((0.5 * this.along) / this.length, 4000);
    this.scale = Math.min(Math.max(this.scale * factor, least), 4000);
    const [nx, ny] = this.toLane(px, py);
    this.x += x - nx;
    this.y += y - ny;
    this.hold();
  }

  pan(px: number, py: number): void {
    const [along, across] = this.turned ? [-py, px] : [px, py];
    this.y -= along / this.scale;
    this.x -= across / this.scaleX;
    this.hold();
  }

  /** Keep the lane in sight: its middle line never leaves the picture for good. */
  hold(): void {
    const centre = (value: number, low: number, high: number, half: number): number =>
      high - low <= 2 * half ? (low + high) / 2 : Math.min(Math.max(value, low + half * 0.5), high - half * 0.5);
    this.y = centre(this.y, this.extent.y_min, this.extent.y_max, this.along / this.scale / 2);
    this.x = centre(this.x, this.extent.x_min, this.extent.x_max, this.across / this.scaleX / 2);
  }

  show(x: number, y: number): void {
    const [px, py] = this.toScreen(x, y);
    const { left, top, width, height } = this.box;
    const inside = px > left + 30 && px < left + width - 30 && py > top + 15 && py < top + height - 15;
    if (inside) return;
    this.x = x;
    this.y = y;
    this.hold();
  }

  /** First and last down-track metre in the picture. */
  span(): [number, number] {
    const half = this.along / this.scale / 2;
    return [this.y - half, this.y + half];
  }
}

export function ticks(low: number, high: number, most: number): number[] {
  const rough = (high - low) / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough)!;
  const found: number[] = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(Math.round(i * step * 1e9) / 1e9);
  return found;
}
