import { UNSEEN } from "./data";
import { el } from "./dom";
import type { LiveAlarm, LiveRows, Moment } from "./history";
import type { Live } from "./live";
import type { Page } from "./page";
import { thresholdsOf } from "./roc";

/** Length of lane in sight when the picture follows the vehicle, and how much of it lies behind the vehicle, m. */
const FOLLOWED = 27;
const BEHIND = 6;

/** Takes what came of a live run into the page, and keeps the picture with the vehicle while that is on. */
export class Following {
  on = false;
  /** The threshold that was chosen when the page went back in time: alarms of then may not have it. */
  private chosen: { least: number | null; last: boolean } | null = null;

  constructor(private readonly app: Page) {}

  /** A live run is known: take its lane, lattice and channel as the source's. */
  begin(live: Live): void {
    const { app } = this;
    const { index } = app.source;
    const own = app.source.title === "live";
    if (!own) return app.redraw();
    const [polarization, subband] = live.channel;
    app.tiles.drop(app.source.id);
    Object.assign(index, { title: live.title, georeference: live.georeference, channel: live.channel, grid: live.grid, tile_rows: 512 });
    index.layers = live.grid ? [{ detection: "live", stage: "live", polarization, subband, percentiles: { "50": 0 }, levels: [{ file: "", rows: 0 }] }] : [];
    index.detections = [live.detection()];
    app.a = { source: 0, set: "live", polarization, subband };
    app.b = { ...app.a };
    app.picture.recolour(app.colours);
    this.extend(live);
    el("roc").hidden = el("list").hidden = false;
    el("subset").hidden = el("roc-plot").hidden = el("explain").hidden = true;
    app.detectionChanged();
    app.showChoices();
    this.set(this.suits(live) || app.driving);
    app.resized();
  }

  /** Whether the picture goes with the vehicle at the desk: over a lane that is long or has no end. */
  suits(live: Live): boolean {
    return live.begun && (live.lane === null || this.app.view.length > 80);
  }

  /** Rows of a live run-view came. */
  grow(live: Live, { row, median, halves }: LiveRows): void {
    const { app } = this;
    const { index, id, title } = app.source;
    const layer = index.layers[0];
    if (title !== "live" || !layer || !live.grid) return;
    if (app.past) return; // the rows are in the run's history, and are drawn when the page comes back to now
    index.grid = live.grid;
    layer.levels[0]!.rows = live.grid.ny;
    app.picture.repaint(id, 0, app.tiles.put(id, 0, row, live.grid.nx, index.tile_rows, halves));
    if (Math.abs(median - (layer.percentiles["50"] ?? 0)) > 0.75) {
      layer.percentiles["50"] = median;
      app.picture.recolour(app.colours);
    }
    if (live.lane === null) this.extend(live);
  }

  /**
   * Show a live run as it was known after a scan, or as it is known now.
   *
   * Rows that came later are unseen then; rows that came before may have been overwritten, so that they are laid anew.
   */
  goTo(now: Live, moment: Moment | null): void {
    const { app } = this;
    const { index, id, title } = app.source;
    const newest = now.history.moments[now.history.moments.length - 1];
    const target = moment ?? newest;
    this.chosen ??= this.threshold();
    app.past = moment && now.asOf(moment);
    if (title === "live" && index.layers.length && now.grid && target) {
      const { nx } = now.grid;
      const { before, after } = now.history.rowsAbout(target);
      const lay = ({ row, halves }: LiveRows): void => app.picture.repaint(id, 0, app.tiles.put(id, 0, row, nx, index.tile_rows, halves));
      for (const rows of after) lay({ ...rows, halves: new Uint16Array(rows.halves.length).fill(UNSEEN) });
      before.forEach(lay);
      index.grid = now.grid;
      index.layers[0]!.levels[0]!.rows = now.grid.ny;
    }
    this.went(now, []);
    if (!moment) this.chosen = null;
  }

  /** The threshold was moved by hand. */
  moved(): void {
    this.chosen = this.app.past ? this.threshold() : null;
  }

  private threshold(): { least: number | null; last: boolean } {
    const { app } = this;
    return { least: app.threshold, last: app.row >= app.thresholds.length - 1 };
  }

  /** Scans and alarms of a live run came. */
  went(now: Live, fresh: LiveAlarm[]): void {
    const { app } = this;
    if (app.past?.at && !now.history.moments.includes(app.past.at)) return this.goTo(now, null); // it is too long ago
    const live = app.past ?? now;
    app.scrub.refresh();
    if (app.source.title === "live") {
      const { index } = app.source;
      const id = app.selected === null ? null : app.detection?.alarms.alarm_id?.[app.selected];
      const ticked = new Set([...app.ticked].map((row) => app.detection?.alarms.alarm_id?.[row]));
      const chosen = this.chosen ?? this.threshold();
      const least = now.wanted ?? chosen.least;
      const last = now.wanted === null && chosen.last;
      index.detections = [live.detection()];
      const names = index.detections[0]!.alarms.alarm_id!;
      app.thresholds = thresholdsOf(app.source, "live");
      const at = app.thresholds.findIndex((one) => one !== null && least !== null && one <= least);
      app.row = last || least === null ? (last ? app.thresholds.length - 1 : 0) : at < 0 ? app.thresholds.length - 1 : app.thresholds[at] === least ? at : Math.max(at - 1, 0);
      if (!app.past) now.least = last ? -Infinity : (least ?? Infinity);
      el<HTMLInputElement>("threshold").max = String(Math.max(app.thresholds.length - 1, 0));
      app.ticked = new Set(names.flatMap((name, row) => (ticked.has(name) ? [row] : [])));
      app.selected = id ? (names.indexOf(id) >= 0 ? names.indexOf(id) : null) : null;
      index.scans = { x: live.track.map((one) => one.x), y: live.track.map((one) => one.y), z: [], heading: live.track.map((one) => one.heading), masked: [] };
      app.evidence.key = "";
      app.showAlarm();
      app.showThreshold();
    }
    const told = fresh.filter((one) => one.confidence >= now.least && !one.final && (now.distance(one) ?? 1) > 0);
    if (told.length) {
      const nearest = told.reduce((a, b) => ((now.distance(b) ?? Infinity) < (now.distance(a) ?? Infinity) ? b : a));
      app.say(`New alarm: ${now.words(nearest)}${told.length > 1 ? `, and ${told.length - 1} more` : ""}`);
    }
    this.keepUp(live);
    live.report();
    app.redraw();
  }

  set(follow: boolean): void {
    const { app } = this;
    this.on = follow;
    el("follow").setAttribute("aria-pressed", String(follow));
    if (!follow || !app.live) return;
    app.fitting = false;
    if (app.driving) return app.redraw(); // the driver's picture is laid about the vehicle as it is drawn
    app.view.fill = true;
    app.view.scale = Math.min(app.view.along / Math.min(FOLLOWED, 6 * app.view.breadth), (0.96 * app.view.across) / app.view.breadth);
    this.keepUp(app.past ?? app.live);
    app.redraw();
  }

  private keepUp(live: Live): void {
    const { app } = this;
    if (!this.on || !live.here || app.driving) return;
    app.view.x = (app.view.extent.x_min + app.view.extent.x_max) / 2;
    app.view.y = live.here.y + app.view.along / app.view.scale / 2 - BEHIND;
  }

  /** A lane without an end is as long as what was seen of it. */
  private extend(live: Live): void {
    const { app } = this;
    const { grid, lane } = live;
    if (!grid) return;
    const x = { x_min: grid.x - grid.dx / 2, x_max: grid.x + (grid.nx - 0.5) * grid.dx };
    const seen = grid.y + Math.max(grid.ny * grid.dy, 20);
    app.source.index.lane = lane ?? { x_min: -1.5, x_max: 1.5, y_min: grid.y, y_max: seen };
    app.view.extent = lane ? { ...x, y_min: Math.min(lane.y_min, grid.y), y_max: lane.y_max } : { ...x, y_min: grid.y, y_max: seen };
    el("overview").hidden = app.view.length < 8 * app.view.breadth;
  }
}
