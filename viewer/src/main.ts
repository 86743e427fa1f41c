import { App } from "./app";
import { getJson, loadSources } from "./data";
import { el } from "./dom";
import { Drive } from "./drive";
import { exportMap, exportPng, exportSvg, exportTable } from "./exporting";
import { fillHelp, listenToKeys } from "./keys";
import { Live } from "./live";
import { Notes } from "./notes";
import { listenToPointer } from "./pointing";
import { loadBackdrop, type Backdrop } from "./backdrop";
import { RawPanel } from "./raw";
import type { Compare, Georeference, Source, Verdict } from "./types";

function input(id: string, act: (field: HTMLInputElement) => void, event = "input"): void {
  el<HTMLInputElement>(id).addEventListener(event, (e) => act(e.target as HTMLInputElement));
}

function click(id: string, act: () => void): void {
  el(id).addEventListener("click", act);
}

function wireChoices(app: App): void {
  for (const side of ["a", "b"] as const) {
    el(`${side}-set`).addEventListener("change", (event) => {
      const [source, ...name] = (event.target as HTMLSelectElement).value.split("/");
      app.choose(side, { source: Number(source), set: name.join("/") });
    });
    el(`${side}-pol`).addEventListener("change", (event) => app.choose(side, { polarization: (event.target as HTMLSelectElement).value }));
    el(`${side}-band`).addEventListener("change", (event) => app.choose(side, { subband: (event.target as HTMLSelectElement).value }));
  }
  for (const radio of document.querySelectorAll<HTMLInputElement>('input[name="compare"]'))
    radio.addEventListener("change", () => app.setCompare(radio.value as Compare));
  el("map").addEventListener("change", (event) => app.setColours({ map: (event.target as HTMLSelectElement).value }));
  input("floor", (field) => app.setColours({ floor: Number(field.value) }));
  input("range", (field) => app.setColours({ range: Number(field.value) }));
  for (const name of ["alarms", "truth", "scans"] as const)
    input(`show-${name}`, (field) => {
      app.show[name] = field.checked;
      app.scoresChanged();
    }, "change");
  input("smooth", (field) => {
    app.smooth = field.checked;
    app.redraw();
  }, "change");
  input("threshold", (field) => app.setThreshold(Number(field.value)));
  const subset = (): void => app.setSubset(el<HTMLSelectElement>("kind").value || null, el<HTMLSelectElement>("depth").value || null);
  el("kind").addEventListener("change", subset);
  el("depth").addEventListener("change", subset);
}

function wireButtons(app: App): void {
  click("zoom-in", () => app.zoom(1.5));
  click("zoom-out", () => app.zoom(1 / 1.5));
  click("zoom-fit", () => app.fit());
  click("zoom-true", () => app.trueScale());
  click("turn", () => app.turn());
  click("follow", () => app.following.set(!app.following.on));
  click("days", () => app.days());
  click("previous", () => app.step(-1));
  click("next", () => app.step(1));
  click("close", () => app.select(null));
  for (const radio of document.querySelectorAll<HTMLInputElement>('input[name="verdict"]'))
    radio.addEventListener("change", () => app.setNote({ verdict: radio.value as Verdict }));
  input("note", (field) => app.setNote({ text: field.value }));
  click("export-png", () => exportPng(app));
  click("export-svg", () => exportSvg(app));
  click("export-csv", () => exportTable(app, "csv"));
  click("export-geojson", () => exportTable(app, "geojson"));
  click("export-map", () => void exportMap(app));
  click("export-notes", () => app.notes.save());
  input("load-notes", (field) => {
    const file = field.files?.[0];
    if (file) void app.loadNotes(file);
    field.value = "";
  }, "change");
  click("help", () => el<HTMLDialogElement>("keys").showModal());
  click("theme", () => app.setTheme(document.documentElement.dataset["theme"] === "dark" ? "light" : "dark"));
  document.addEventListener("pointerdown", (event) => {
    const menu = el<HTMLDetailsElement>("export-menu");
    if (menu.open && !menu.contains(event.target as Node)) menu.open = false;
  });
}

/** A source without pictures for a live run that has no result yet. */
function liveSource(): Source {
  const lane = { x_min: -5, x_max: 5, y_min: 0, y_max: 100 };
  return {
    id: 0,
    title: "live",
    identity: "",
    score: null,
    index: {
      title: "live",
      lane,
      grid: null,
      tile_rows: 0,
      channel: ["", ""],
      layers: [],
      scans: { x: [], y: [], z: [], heading: [], masked: [] },
      georeference: null,
      detections: [],
    },
  };
}

interface Session {
  results: string[];
  identities: string[];
  live: boolean;
  answers: boolean;
  raw: boolean;
  map: boolean;
  verdicts: string | null;
  georeference: Georeference | null;
  backdrop: Backdrop["box"] | null;
}

async function start(): Promise<void> {
  document.documentElement.dataset["theme"] = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  fillHelp();
  const session = await getJson<Session>("data/session.json");
  const sources = await loadSources(session.results, session.identities);
  let app: App | null = null;
  const live: Live | null = session.live
    ? new Live({
        began: (one) => app?.following.begin(one),
        rows: (rows) => live && app?.following.grow(live, rows),
        changed: (fresh) => live && app?.following.went(live, fresh),
      })
    : null;
  if (!sources.length && live) sources.push(liveSource());
  for (const { index } of sources) index.georeference = session.georeference ?? index.georeference;
  el("follow").hidden = !live;
  el("export-map").hidden = !session.map || !sources.some(({ index }) => index.georeference && index.detections.length);
  const notes = new Notes(sources, session.verdicts);
  await notes.open();
  app = new App(sources, notes);
  app.live = live;
  if (session.backdrop) app.backdrop = loadBackdrop(session.backdrop, () => app?.redraw());
  const title = sources.map((one) => one.title).join(" / ");
  el("title").textContent = el("title").title = title;
  document.title = `${title} – flgpr`;
  wireChoices(app);
  wireButtons(app);
  listenToPointer(app);
  listenToKeys(app);
  if (live) {
    const drive = new Drive(app, live, session.answers);
    if (!session.results.length) drive.show(true);
    live.start();
  }
  app.scrub.refresh();
  const run = sources[0]?.index.run;
  if (run && session.raw) {
    app.raw = new RawPanel(sources[0]!, (scan) => app?.markScan(scan));
    app.resized();
  } else if (run) app.complain(`A run of ${sources[0]!.index.scans.y.length} scans, ${run.pairs} pairs, ${run.polarizations.join(" ")}, ${run.tones} tones. Pictures come with a result: flgpr detect.`);
}

start().catch((error: Error) => {
  el("message").textContent = error.message;
  el("message").hidden = false;
});
