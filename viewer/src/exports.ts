import { escapeXml } from "./pen";
import type { Detection, Note, Source } from "./types";

export function download(name: string, content: Blob | string, kind = "text/plain"): void {
  const blob = content instanceof Blob ? content : new Blob([content], { type: kind });
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export interface Row {
  alarm_id: string;
  x: number;
  y: number;
  confidence: number;
  label: string;
  verdict: string;
  note: string;
  [feature: string]: string | number | null;
}

export function alarmRows(source: Source, detection: Detection, rows: number[], note: (row: number) => Note): Row[] {
  const scored = source.score?.detections[detection.name];
  return rows.map((row) => {
    const { verdict, text } = note(row);
    const features = Object.fromEntries(Object.entries(detection.features).map(([name, column]) => [name, column[row] ?? null]));
    return {
      alarm_id: detection.alarms.alarm_id?.[row] ?? `alarm-${row + 1}`,
      x: detection.alarms.x[row]!,
      y: detection.alarms.y[row]!,
      confidence: detection.alarms.confidence[row]!,
      ...features,
      label: scored?.label[row] ?? "",
      verdict,
      note: text,
    };
  });
}

/** A cell that a spreadsheet takes as text: quoted where needed, and never the start of a formula. */
function cell(value: string | number | null): string {
  if (value === null) return "";
  if (typeof value === "number") return String(value);
  const safe = /^[=+\-@\t\r]/.test(value) ? "'" + value : value;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}

export function asCsv(rows: Row[]): string {
  const first = rows[0];
  if (!first) return "alarm_id,x,y,confidence,label,verdict,note\n";
  const names = Object.keys(first);
  return [names.map(cell).join(","), ...rows.map((row) => names.map((name) => cell(row[name] ?? null)).join(","))].join("\n") + "\n";
}

export function asGeoJson(rows: Row[], place: ((x: number, y: number) => [number, number]) | null): string {
  const features = rows.map(({ x, y, ...properties }) => ({
    type: "Feature",
    geometry: { type: "Point", coordinates: place ? [...place(x, y)].reverse() : [x, y] },
    properties: place ? { x, y, ...properties } : properties,
  }));
  const frame = place ? {} : { flgpr_frame: "lane frame: x cross-track, y down-track, metres; not longitude and latitude" };
  return JSON.stringify({ type: "FeatureCollection", ...frame, features }, null, 1) + "\n";
}

export function withRaster(raster: string, x: number, y: number, width: number, height: number, paper: string, title: string): string {
  return (
    `<title>${escapeXml(title)}</title><rect width="100%" height="100%" fill="${paper}"/>` +
    `<image x="${x}" y="${y}" width="${width}" height="${height}" preserveAspectRatio="none" href="${raster}"/>`
  );
}
