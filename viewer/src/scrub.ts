import { el, fixed } from "./dom";
import type { Page } from "./page";

/**
 * The slider through the scans above the picture.
 *
 * Of a live run or its recording it goes back in time: vehicle, alarms and run-view as they were after a scan. Of a result or
 * a run it marks a scan on the track, with the ground that it sees; a run shows that scan's raw data as well.
 */
export class Scrub {
  constructor(private readonly app: Page) {
    el("scan").addEventListener("input", (event) => this.goTo(Number((event.target as HTMLInputElement).value)));
    el("scan-all").addEventListener("click", () => this.goTo(null));
  }

  /** Bring the slider up to date with what is shown; without two scans there is none. */
  refresh(): void {
    const { app } = this;
    const count = this.count();
    el("scrub").hidden = count < 2 || app.source.index.scored === true;
    if (el("scrub").hidden) return;
    const slider = el<HTMLInputElement>("scan");
    const at = this.position();
    slider.max = String(count - 1);
    slider.value = String(at ?? (app.live ? count - 1 : 0));
    const words = at === null ? this.wordsOfAll(count) : this.wordsOf(at, count);
    el("scan-out").textContent = words;
    slider.setAttribute("aria-valuetext", words);
    const button = el<HTMLButtonElement>("scan-all");
    button.textContent = app.live ? "now" : "all scans";
    button.disabled = at === null;
  }

  /** Go some scans on or back. */
  step(by: number): void {
    const count = this.count();
    if (count < 2) return;
    const at = this.position() ?? (this.app.live ? count - 1 : by > 0 ? -1 : 0);
    this.goTo(Math.min(Math.max(at + by, 0), count - 1));
  }

  private goTo(at: number | null): void {
    const { app } = this;
    if (app.live) {
      const moments = app.live.history.moments;
      const now = at === null || at >= moments.length - 1;
      app.following.goTo(app.live, now ? null : moments[at]!);
    } else if (at !== null && app.raw) app.raw.markScan(at);
    else app.markScan(at);
    this.refresh();
  }

  private count(): number {
    const { live, source } = this.app;
    return live ? live.history.moments.length : source.index.scans.y.length;
  }

  /** The scan that is gone to, counted from the first; null where all of them are shown. */
  private position(): number | null {
    const { live, past, scan } = this.app;
    if (!live) return scan;
    return past?.at ? live.history.moments.indexOf(past.at) : null;
  }

  private wordsOfAll(count: number): string {
    return this.app.live ? `now: ${count} scans` : `all ${count} scans`;
  }

  private wordsOf(at: number, count: number): string {
    const { live, source } = this.app;
    if (live) {
      const { scan, y } = live.history.moments[at]!;
      return `scan ${scan} of ${count}, y ${fixed(y, 1)} m`;
    }
    const { scans, sight } = source.index;
    const place = `scan ${at} of ${count}, y ${fixed(scans.y[at]!, 1)} m`;
    if (scans.masked.includes(at)) return `${place}: left out, sweeps are missing`;
    return sight ? `${place}, sees ${fixed(sight[0], 1)} to ${fixed(sight[1], 1)} m ahead` : place;
  }
}
