import type { App } from "./app";
import { el, fixed } from "./dom";
import type { LiveAlarm } from "./history";
import { LABELLED, chances, type Live } from "./live";
import { Sound } from "./sound";

/** How often the page looks at its own clock, and after what silence something is lost, ms; a slower radar has its rhythm. */
const LOOK = 100;
const SILENCE = 750;
const [BEATS, FEW, LONGEST] = [2.5, 4, 5000];
/** Positions that stay wrong for so long, ms, or for two scans in a row, are told: a single one costs a scan, no more. */
const DOUBT = 400;
/** Scans that are shown later than this after they came are told as late, ms. */
const BEHIND = 1000;
const LISTED = 3;
/** The least screen, px, for which type and buttons have their sizes, lying and upright; drive.css shrinks them on a smaller one. */
const LEAST_LYING = [1024, 768] as const;
const LEAST_UPRIGHT = [640, 1280] as const;
/** The picture's type of 11 px is as large as 29 px then: 12 minutes of arc from 1.5 m. */
const ENLARGED = 2.6;
/** What the driver is told of scans that went wrong. */
const TOLD: Record<string, string> = { missing: "lost", late: "late", duplicate: "twice", masked: "holes", corrupt: "corrupt", refused: "refused", pose_missing: "no pose", implausible: "wrong place", restarts: "moved" };
/** What the driver is told where a radar sees nothing, or nobody knows where it is, and what to do. */
const HALTED: Record<string, readonly [string, string]> = {
  "no positions": ["No positions", "check the GPS"],
  "frozen positions": ["Positions frozen", "check the GPS"],
  "repeated scans": ["Radar frozen", "start it again"],
  noise: ["Radar blind", "check the transmitter"],
};
const THEMES = { light: "Day", night: "Night", sun: "Sun" };
type Theme = keyof typeof THEMES;

export interface Health { level: "ok" | "wait" | "lost" | "slow" | "over"; words: string; detail: string }

/** Whether anything still comes, from the page's own clock: the first thing that is wrong on the way from the radar. */
export function health(live: Live, now: number): Health {
  const { came, age } = live;
  const lost = (words: string, silence: number): Health => ({ level: "lost", words, detail: `for ${fixed(silence / 1000, 1)} s` });
  const unheard = now - came.answer;
  if (unheard > SILENCE) return lost("No connection", unheard);
  if (live.ended) return { level: "over", words: "Run ended", detail: "no scan comes any more" };
  if (age === null) return { level: "wait", words: "Waiting", detail: "for detection to begin" };
  const still = 1000 * age + unheard;
  if (still > SILENCE) return live.begun ? lost("Detection stopped", still) : { level: "wait", words: "Waiting", detail: "for detection: it loads, or does not run" };
  if (!live.begun) return { level: "wait", words: "Waiting", detail: "for the first scan" };
  const sorted = [...live.rhythm].sort((a, b) => a - b);
  const rhythm = sorted.length < FEW ? 0 : sorted[sorted.length >> 1]!;
  const limit = Math.max(SILENCE, Math.min(BEATS * rhythm, LONGEST));
  if (now - came.frame > limit) return lost("No radar", now - came.frame);
  const { wrong } = live;
  if (wrong && (wrong.scans > 1 || now - wrong.since > DOUBT)) return { level: "lost", words: "Positions wrong", detail: "check the GPS" };
  if (live.halted !== null) {
    const [words, detail] = HALTED[live.halted] ?? ["Radar at fault", "check it"];
    return { level: "lost", words, detail };
  }
  if (now - came.use > limit) return lost("Scans unusable", now - came.use);
  if (live.delay > BEHIND) return { level: "slow", words: "Too slow", detail: `${fixed(live.delay / 1000, 1)} s late` };
  return { level: "ok", words: "", detail: "" };
}

/** The driver's screen: what is nearest, whether the vehicle stops before it, and whether anything still comes. */
export class Drive {
  readonly sound = new Sound();
  private on = false;
  private shown = "";
  private known: Set<string> | null = null;
  private runs = 0;
  private readonly dead: Animation | undefined;

  constructor(
    private readonly app: App,
    private readonly live: Live,
  ) {
    el("state").hidden = el("frozen").hidden = el("to-drive").hidden = false;
    this.dead = el("frozen").getAnimations()[0];
    this.wire();
    this.judgeScreen();
    addEventListener("resize", () => this.judgeScreen());
    setTimeout(() => this.look(), LOOK);
  }

  /** Shrink the picture's words as drive.css shrinks its type, and tell where the screen is too small for their sizes. */
  private judgeScreen(): void {
    const { app } = this;
    const [width, height] = [window.innerWidth, window.innerHeight];
    const least = height >= width ? LEAST_UPRIGHT : LEAST_LYING;
    const unit = Math.min(1, width / least[0], height / least[1]);
    const enlarged = this.on ? Math.max(ENLARGED * unit, 1) : 1;
    if (enlarged !== app.enlarged) {
      app.enlarged = enlarged;
      app.resized();
    }
    const small = unit < 1;
    el("drive-small").hidden = !small;
    el("drive-small").textContent = small ? `Screen too small: ${width} × ${height} px. It needs ${LEAST_LYING.join(" × ")}, or ${LEAST_UPRIGHT.join(" × ")} upright.` : "";
  }

  /** Show the driver's screen or the desk's. */
  show(on: boolean): void {
    const { app, live } = this;
    this.on = on;
    document.body.classList.toggle("driving", on);
    el("drive").hidden = !on;
    const theme = document.documentElement.dataset["theme"]!;
    if (on && theme === "dark") this.dress("night");
    if (!on && theme !== "dark") app.setTheme(theme === "night" ? "dark" : "light");
    if (on && app.past) app.following.goTo(live, null); // the driver sees what is known now
    app.driving = on;
    app.view.turned = on;
    this.judgeScreen();
    live.labelled = on ? 0 : LABELLED; // what the picture says is as old as its scan; the number beside it is not
    if (on) app.select(null);
    app.resized();
    if (on || app.following.suits(live)) app.following.set(true);
    else app.fit();
  }

  private wire(): void {
    const { app, live } = this;
    const click = (id: string, act: () => void): void => el(id).addEventListener("click", act);
    const settings = el<HTMLDialogElement>("drive-settings");
    const change = (id: string, act: (sign: number) => void): void => {
      for (const [name, sign] of [["less", -1], ["more", 1]] as const)
        click(`${id}-${name}`, () => {
          act(sign);
          this.settings();
        });
    };
    const within = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
    click("to-drive", () => this.show(true));
    click("to-desk", () => this.show(false));
    click("drive-theme", () => {
      const names = Object.keys(THEMES) as Theme[];
      this.dress(names[(names.indexOf(document.documentElement.dataset["theme"] as Theme) + 1) % names.length]!);
    });
    click("drive-sound", () => {
      this.sound.toggle().catch(() => (this.sound.on = false)).finally(() => this.dressSound());
    });
    click("drive-set", () => {
      this.settings();
      settings.showModal();
    });
    click("drive-close", () => settings.close());
    click("set-measured", () => {
      live.chosen = null;
      this.settings();
    });
    change("set-speed", (sign) => (live.chosen = within(Math.round(3.6 * (live.speed ?? 15 / 3.6)) + sign, 1, 120) / 3.6));
    change("set-reaction", (sign) => (live.reaction = within(Math.round(10 * live.reaction + sign) / 10, 0, 10)));
    change("set-brake", (sign) => (live.deceleration = within(Math.round(2 * live.deceleration + sign) / 2, 0.5, 10)));
    change("set-alarms", (sign) => app.setThreshold(app.row + sign * Math.ceil(app.thresholds.length / 20)));
  }

  private dress(theme: Theme): void {
    this.app.setTheme(theme);
    el("drive-theme").textContent = THEMES[theme];
  }

  private dressSound(): void {
    el("drive-sound").textContent = this.sound.on ? "Sound on" : "Sound off";
    el("drive-sound").setAttribute("aria-pressed", String(this.sound.on));
  }

  private settings(): void {
    const { app, live } = this;
    el("set-speed-out").textContent = live.speed === null ? "not known" : `${fixed(3.6 * live.speed, 0)} km/h${live.chosen === null ? "" : " fixed"}`;
    el("set-reaction-out").textContent = `${fixed(live.reaction, 1)} s`;
    el("set-brake-out").textContent = `${fixed(live.deceleration, 1)} m/s²`;
    el("set-alarms-out").textContent = `${app.shownRows().length} of ${live.alarms.size}`;
    el("set-sum").textContent = live.stopping === null ? "" : `Stops in ${fixed(live.stopping, 1)} m`;
  }

  /** Look at the clock and at what came; a page whose scripts stand still is told by an animation that no script stops. */
  private look(): void {
    setTimeout(() => this.look(), LOOK);
    if (this.dead) this.dead.currentTime = 0;
    const now = performance.now();
    const state = health(this.live, now);
    this.showState(state, now);
    const ahead = this.ahead();
    if (this.on) this.showAhead(ahead, state);
    this.ring(ahead, state);
  }

  /** Alarms before the vehicle where it is now, not where the last scan was taken. */
  private ahead(): { alarm: LiveAlarm; left: number }[] {
    const { live } = this;
    return live.ahead(live.least).map(({ alarm, left }) => ({ alarm, left: left - live.driven })).filter(({ left }) => left > 0);
  }

  private showState(state: Health, now: number): void {
    const { live } = this;
    const bar = el("state");
    bar.className = state.level;
    if (state.words !== this.shown) el("state-words").textContent = this.shown = state.words;
    const speed = live.measured;
    const scan = live.track[live.track.length - 1]?.scan;
    const rhythm = live.rhythm.length ? live.rhythm.reduce((a, b) => a + b, 0) / live.rhythm.length : 0;
    const parts = [scan === undefined ? "" : `scan ${scan}`, rhythm ? `${fixed(1000 / rhythm, 1)} per s` : "", speed === null ? "" : `${fixed(3.6 * speed, 0)} km/h`];
    el("state-detail").textContent = state.detail || parts.filter(Boolean).join(" · ");
    el("state-clock").textContent = new Date().toTimeString().slice(0, 8);
    el("beat").classList.toggle("on", now - live.came.frame < LOOK * 1.5);
  }

  private showAhead(ahead: { alarm: LiveAlarm; left: number }[], state: Health): void {
    const { live } = this;
    const [nearest, ...rest] = ahead;
    const stale = state.level !== "ok" && state.level !== "slow";
    const { stopping } = live;
    const margin = nearest && stopping !== null ? nearest.left - stopping : null;
    const verdict = state.level === "lost" ? "blind" : stale ? "free" : !nearest ? "free" : margin === null ? "unknown" : margin < 0 ? "halt" : "go";
    el("drive").dataset["verdict"] = verdict;
    el("drive-left").textContent = stale || !nearest ? "–" : `${fixed(nearest.left, 1)} m`;
    el("drive-head").textContent = nearest && !stale && live.besideLane(nearest.alarm) ? "Beside lane" : "Nearest";
    const aside = nearest ? live.aside(nearest.alarm) : 0;
    el("drive-aside").textContent = stale ? "not known" : nearest ? `${fixed(Math.abs(aside), 1)} m ${aside < 0 ? "left" : "right"}` : live.sight > 0 ? `none in ${fixed(live.sight, 0)} m` : "nothing seen yet";
    const unlike = live.unlike.length > 0;
    el("drive-chances").classList.toggle("unlike", unlike);
    el("drive-chances").textContent = stale ? "" : unlike ? "Ground unlike the training" : nearest ? chances(nearest.alarm) : "";
    const spare = verdict === "go" && nearest!.alarm.wait ? ", look again" : " to spare";
    const words = { blind: "Stop", free: "–", unknown: "Speed?", halt: "Cannot stop", go: "Can stop" };
    el("drive-verdict").textContent = words[verdict];
    el("drive-margin").textContent = verdict === "blind"
      ? "alarms are not shown"
      : margin !== null && !stale
        ? `${fixed(Math.abs(margin), 1)} m${margin < 0 ? " too near" : spare}`
        : verdict === "unknown"
          ? "set it in Vehicle"
          : "";
    const from = live.chosen !== null ? " set" : live.measured !== null ? "" : " stated";
    el("drive-speed").textContent = live.speed === null ? "speed not known" : `${fixed(3.6 * live.speed, 0)} km/h${from} stops in ${fixed(live.stopping ?? 0, 1)} m`;
    el("drive-next").textContent = !stale && rest.length ? `then ${rest.slice(0, LISTED - 1).map(({ left }) => `${fixed(left, 1)} m`).join(", ")}${rest.length >= LISTED ? " …" : ""}` : "";
    const faults = Object.entries(TOLD).flatMap(([name, what]) => (live.counts[name] ? [`${what} ${live.counts[name]}`] : []));
    const lines = faults.length ? [`scans: ${faults.join(", ")}`] : [];
    if (live.found.size) lines.push(`radar: ${[...live.found].join(", ")}`);
    el("drive-faults").textContent = lines.join("; ");
  }

  private ring(ahead: { alarm: LiveAlarm; left: number }[], state: Health): void {
    if (document.hidden) return; // the browser lets a page in the background look at its clock only now and then
    const { live, sound } = this;
    if (live.runs !== this.runs) [this.runs, this.known] = [live.runs, null]; // of a run begun anew none is known
    if (state.level === "over" || state.level === "wait") return; // nothing ahead is known any more, or yet
    const names = ahead.map(({ alarm }) => alarm.id);
    const fresh = this.known !== null && names.some((name) => !this.known!.has(name));
    if (live.caughtUp) this.known = new Set([...(this.known ?? []), ...names]);
    const [nearest] = ahead;
    const { stopping } = live;
    if (state.level === "lost") sound.play(220, 0.5, 0.3);
    else if (nearest && stopping !== null && nearest.left < stopping) sound.play(1200, 0.12, 0.12);
    else if (state.level === "slow") sound.play(220, 0.5, 0.3);
    else if (fresh) sound.play(880, 0.25, 0);
  }
}
