/** The same drawing on a canvas and as SVG. */
export interface Style { stroke?: string; fill?: string; width?: number; dash?: number[]; alpha?: number }
export interface TextStyle { fill: string; size?: number; anchor?: "start" | "middle" | "end"; halo?: string; bold?: boolean; turn?: boolean }
export type Point = [number, number];

export interface Pen {
  path(points: Point[], closed: boolean, style: Style): void;
  ellipse(x: number, y: number, rx: number, ry: number, style: Style): void;
  text(x: number, y: number, words: string, style: TextStyle): void;
}

export const FONT = "system-ui, sans-serif";

export class CanvasPen implements Pen {
  constructor(private readonly context: CanvasRenderingContext2D) {}

  private finish(style: Style): void {
    const c = this.context;
    c.globalAlpha = style.alpha ?? 1;
    if (style.fill) {
      c.fillStyle = style.fill;
      c.fill();
    }
    if (style.stroke) {
      c.strokeStyle = style.stroke;
      c.lineWidth = style.width ?? 1;
      c.setLineDash(style.dash ?? []);
      c.stroke();
      c.setLineDash([]);
    }
    c.globalAlpha = 1;
  }

  path(points: Point[], closed: boolean, style: Style): void {
    this.context.beginPath();
    for (const [i, [x, y]] of points.entries()) i ? this.context.lineTo(x, y) : this.context.moveTo(x, y);
    if (closed) this.context.closePath();
    this.finish(style);
  }

  ellipse(x: number, y: number, rx: number, ry: number, style: Style): void {
    this.context.beginPath();
    this.context.ellipse(x, y, rx, ry, 0, 0, 2 * Math.PI);
    this.finish(style);
  }

  text(x: number, y: number, words: string, style: TextStyle): void {
    const c = this.context;
    c.save();
    c.translate(x, y);
    if (style.turn) c.rotate(-Math.PI / 2);
    c.font = `${style.bold ? "600 " : ""}${style.size ?? 12}px ${FONT}`;
    c.textAlign = style.anchor === "middle" ? "center" : (style.anchor ?? "start");
    c.textBaseline = "alphabetic";
    if (style.halo) {
      c.strokeStyle = style.halo;
      c.lineWidth = 3;
      c.lineJoin = "round";
      c.strokeText(words, 0, 0);
    }
    c.fillStyle = style.fill;
    c.fillText(words, 0, 0);
    c.restore();
  }
}

const round = (value: number): string => String(Math.round(value * 100) / 100);
export const escapeXml = (text: string): string =>
  text.replace(/[<>&"']/g, (sign) => `&#${sign.charCodeAt(0)};`).replace(/[\u0000-\u0008\u000b\u000c\u000e-\u001f]/g, "");

export class SvgPen implements Pen {
  readonly parts: string[] = [];

  private paint(style: Style): string {
    return (
      ` fill="${style.fill ?? "none"}"` +
      (style.stroke ? ` stroke="${style.stroke}" stroke-width="${style.width ?? 1}"` : "") +
      (style.dash ? ` stroke-dasharray="${style.dash.join(" ")}"` : "") +
      (style.alpha !== undefined ? ` opacity="${style.alpha}"` : "")
    );
  }

  path(points: Point[], closed: boolean, style: Style): void {
    const d = points.map(([x, y], i) => `${i ? "L" : "M"}${round(x)} ${round(y)}`).join("") + (closed ? "Z" : "");
    this.parts.push(`<path d="${d}"${this.paint(style)}/>`);
  }

  ellipse(x: number, y: number, rx: number, ry: number, style: Style): void {
    this.parts.push(
      `<ellipse cx="${round(x)}" cy="${round(y)}" rx="${round(rx)}" ry="${round(ry)}"${this.paint(style)}/>`,
    );
  }

  text(x: number, y: number, words: string, style: TextStyle): void {
    const halo = style.halo ? ` stroke="${style.halo}" stroke-width="3" stroke-linejoin="round" paint-order="stroke"` : "";
    const turn = style.turn ? ` transform="rotate(-90 ${round(x)} ${round(y)})"` : "";
    this.parts.push(
      `<text x="${round(x)}" y="${round(y)}" font-family="${FONT}" font-size="${style.size ?? 12}" ` +
        `font-weight="${style.bold ? 600 : 400}" text-anchor="${style.anchor ?? "start"}" fill="${style.fill}"${halo}${turn}>` +
        `${escapeXml(words)}</text>`,
    );
  }

  svg(width: number, height: number, before = ""): string {
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">` +
      `${before}${this.parts.join("")}</svg>`
    );
  }
}
