import { App } from "./app";
import type { Compare } from "./compare";
import { getJson, loadSources } from "./data";
import { el } from "./dom";
import { Drive } from "./drive";
import { fillHelp, listenToKeys } from "./keys";
import { Live } from "./live";
import { Notes } from "./notes";
import { overviewTo } from "./overview";
import { loadBackdrop, type Backdrop } from "./backdrop";
import { RawPanel } from "./raw";
import type { Georeference, Source, Verdict } from "./types";

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
  click("previous", () => app.step(-1));
  click("next", () => app.step(1));
  click("close", () => app.select(null));
  for (const radio of document.querySelectorAll<HTMLInputElement>('input[name="verdict"]'))
    radio.addEventListener("change", () => app.setNote({ verdict: radio.value as Verdict }));
  input("note", (field) => app.setNote({ text: field.value }));
  click("export-png", () => app.exportPng());
  click("export-svg", () => app.exportSvg());
  click("export-csv", () => app.exportTable("csv"));
  click("export-geojson", () => app.exportTable("geojson"));
  click("export-map", () => void app.exportMap());
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

function wirePointer(app: App): void {
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
      app.point(x, y);
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
    if (held && !held.moved && !held.dividing && event.type === "pointerup") app.click(...place(event));
    held = null;
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => app.point(-1, -1));
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
  wirePointer(app);
  listenToKeys(app);
  if (live) {
    const drive = new Drive(app, live);
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
