import type { App } from "./app";
import { drawComparison, rasters } from "./compare";
import { setLabel } from "./data";
import { colour, digits } from "./dom";
import { alarmRows, asCsv, asGeoJson, download } from "./exports";
import { savePng, saveSvg, type FigureParts } from "./figure";
import { geographic } from "./geo";
import { colourBar } from "./lane";
import { drawOverlay } from "./overlay";

/** Save the picture with title, axes and colour bar. */
export function exportPng(app: App): void {
  savePng(parts(app), app.view);
}

/** Save the same with symbols, axes and words as vectors. */
export function exportSvg(app: App): void {
  saveSvg(parts(app), app.view);
}

function parts(app: App): FigureParts {
  return {
    title: describePicture(app),
    palette: { ...app.palette(), text: colour("ink") },
    raster: (context, factor) => rasters(app, context, factor),
    over: (pen) => {
      drawOverlay(pen, app.view, app.overlay());
      drawComparison(app, pen);
    },
    around: (pen, palette) => {
      app.picture.axes(pen, palette);
      colourBar(pen, app.view.box, app.colours, palette, app.view.box.top);
    },
  };
}

function describePicture(app: App): string {
  const { polarization, subband, set } = app.a;
  const { floor, range } = app.colours;
  return `${app.source.index.title}: ${setLabel(app.source, set)}, ${polarization} ${subband}; ${digits(floor)} to ${digits(floor + range)} dB above the median`;
}

/** Save the alarms that are chosen, with their notes. */
export function exportTable(app: App, form: "csv" | "geojson"): void {
  if (!app.detection) return;
  const rows = alarmRows(app.source, app.detection, app.exportRows(), (row) => app.note(row));
  if (form === "csv") download("flgpr-alarms.csv", asCsv(rows), "text/csv");
  else {
    // GeoJSON is longitude and latitude; places in the lane alone are JSON, which no map takes for places on Earth.
    const place = geographic(app.source.index.georeference);
    if (place) download("flgpr-alarms.geojson", asGeoJson(rows, place), "application/geo+json");
    else download("flgpr-alarms.json", asGeoJson(rows, null), "application/json");
  }
}

/** A project of QGIS with the layers of the result in picture A, made by the server. */
export async function exportMap(app: App): Promise<void> {
  app.say("The map is being made");
  const answer = await fetch(`data/${app.source.id}/map.zip`);
  if (answer.ok) return download("flgpr-map.zip", await answer.blob());
  const content = await answer.json().catch(() => null);
  app.complain(content?.error ?? `the map: ${answer.status}`);
}
