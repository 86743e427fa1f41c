import { Answers } from "./answers";
import type { App } from "./app";
import type { Colours } from "./colour";
import { el, fixed, unbroken } from "./dom";
import { health, type Health } from "./health";
import { counts, instruct, type Instruction, type Word } from "./instruct";
import { LABELLED, chances, type Live } from "./live";
import type { Scene } from "./road";
import { Sound, Voice } from "./sound";

/** How often the page looks at its own clock, ms. */
const LOOK = 100;
/** The least screen, px, for which type and buttons have their sizes, lying and upright; drive.css shrinks them on a smaller one. */
const LEAST_LYING = [1024, 768] as const;
const LEAST_UPRIGHT = [640, 1024] as const;
/** From where type of full size is read, m. */
const READ_FROM = 1.5;
/** The picture's type of 11 px is as large as 29 px then: 12 minutes of arc from 1.5 m. */
const ENLARGED = 2.6;
/** Radar below so many dB over the median is ground, and shown as such. */
const NOISE = 6;
const THEMES = { light: "Day", night: "Night", sun: "Sun" };
type Theme = keyof typeof THEMES;
const WORDS: Record<Word, string> = { clear: "Clear", slow: "Slow", brake: "Brake", stop: "Stop", over: "Over an alarm" };
/** What a probability holds under: its prior is the share of mines among what the model was trained on. */
const CHANGES = "what lay there before is not shown";
const PRIOR = "if mines lie as thick as in training";

/** The driver's screen: one instruction, and the road that it is about. */
export class Drive {
  readonly sound = new Sound();
  readonly voice = new Voice();
  private readonly answers: Answers;
  private on = false;
  private shown = "";
  private before: Word = "stop";
  private known: Set<string> | null = null;
  private runs = 0;
  private desk: Colours | null = null;
  private readonly dead: Animation | undefined;

  constructor(
    private readonly app: App,
    private readonly live: Live,
    mayAnswer: boolean,
  ) {
    el("state").hidden = el("frozen").hidden = el("to-drive").hidden = false;
    this.answers = new Answers(live, mayAnswer);
    el("drive-voice").hidden = !this.voice.exists;
    this.dead = el("frozen").getAnimations()[0];
    this.wire();
    this.judgeScreen();
    addEventListener("resize", () => this.judgeScreen());
    setTimeout(() => this.look(), LOOK);
  }

  /** Shrink the picture's words as drive.css shrinks its type, and tell from where a small screen is read. */
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
    el("drive-small").hidden = unit >= 1;
    el("drive-small").textContent = `Small screen: read it from ${fixed(READ_FROM * unit, 1)} m`;
  }

  /** Show the driver's screen or the desk's. */
  show(on: boolean): void {
    const { app, live } = this;
    this.on = on;
    document.body.classList.toggle("driving", on);
    el("drive").hidden = !on;
    const theme = document.documentElement.dataset["theme"]!;
    if (on && app.past) app.following.goTo(live, null); // the driver sees what is known now
    app.driving = on;
    app.view.turned = on;
    if (on && theme === "dark") this.dress("night");
    else if (on) this.dim();
    if (!on) this.undim();
    if (!on && theme !== "dark") app.setTheme(theme === "night" ? "dark" : "light");
    this.judgeScreen();
    live.labelled = LABELLED;
    if (on) app.select(null);
    app.resized();
    if (on || app.following.suits(live)) app.following.set(true);
    else app.fit();
  }

  /** Ground without an echo is as dark as the road, and echoes are grey: colour is for what the driver must know. */
  private dim(): void {
    const { app } = this;
    this.desk ??= app.colours;
    const isDark = document.documentElement.dataset["theme"] === "night";
    app.setColours({ map: isDark ? "grey" : "grey, inverted", floor: NOISE, range: this.desk.range });
  }

  private undim(): void {
    if (this.desk) this.app.setColours(this.desk);
    this.desk = null;
  }

  private wire(): void {
    const click = (id: string, act: () => void): void => el(id).addEventListener("click", act);
    click("to-drive", () => this.show(true));
    click("to-desk", () => this.show(false));
    click("drive-theme", () => {
      const names = Object.keys(THEMES) as Theme[];
      this.dress(names[(names.indexOf(document.documentElement.dataset["theme"] as Theme) + 1) % names.length]!);
    });
    click("drive-sound", () => {
      this.sound.toggle().catch(() => (this.sound.on = false)).finally(() => this.press("drive-sound", this.sound.on));
    });
    click("drive-voice", () => {
      this.voice.toggle();
      this.press("drive-voice", this.voice.on);
    });
  }

  private dress(theme: Theme): void {
    this.app.setTheme(theme);
    el("drive-theme").textContent = THEMES[theme];
    this.dim();
  }

  private press(id: string, on: boolean): void {
    el(id).setAttribute("aria-pressed", String(on));
  }

  /** Look at the clock and at what came; a page whose scripts stand still is told by an animation that no script stops. */
  private look(): void {
    setTimeout(() => this.look(), LOOK);
    if (this.dead) this.dead.currentTime = 0;
    const { app, live } = this;
    const now = (live.moment = performance.now());
    const state = health(live, now);
    this.showState(state, now);
    const scene = this.scene(state);
    const instruction = scene?.instruction ?? STOP;
    this.before = instruction.word;
    if (this.on) {
      app.scene = scene;
      app.redraw();
      this.showInstruction(instruction, scene, state);
      this.voice.say(instruction);
    }
    this.ring(instruction, scene, state);
  }

  /** All that picture and words are made of, as of this look; null while it is not known who drives where. */
  private scene(state: Health): Scene | null {
    const { live } = this;
    const { numbers, now: pose, vehicle, speed } = live;
    if (!numbers || !pose || !vehicle) return null;
    const places = live.places();
    const blind = state.level !== "ok" && state.level !== "slow";
    const update = live.update + LOOK / 1000;
    const instruction = instruct(numbers, { blind, speed, update, sight: live.sight, alarms: places, before: this.before });
    const braking = speed === null ? null : (live.stopping ?? 0) + speed * update + numbers.clearance;
    return { numbers, tyre: vehicle.tyre, pose, places, instruction, braking, sight: live.sight };
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
    el("state-detail").textContent = state.detail || unbroken(parts.filter(Boolean).join(" · "));
    el("state-clock").textContent = new Date().toTimeString().slice(0, 8);
    el("beat").classList.toggle("on", now - live.came.frame < LOOK * 1.5);
  }

  private showInstruction(instruction: Instruction, scene: Scene | null, state: Health): void {
    const { live } = this;
    const { word, alarm } = instruction;
    el("drive").dataset["word"] = word;
    const told = el("drive-word");
    if (told.textContent !== WORDS[word]) told.textContent = WORDS[word];
    el("drive-how").textContent = unbroken(this.how(instruction, state));
    const aside = alarm?.aside ?? 0;
    const place = alarm && (alarm.left > 0 ? `${fixed(alarm.left, 1)} m ahead` : "under the vehicle");
    const none = live.sight > 0 ? `no alarm in ${fixed(live.sight, 0)} m` : "no ground seen yet";
    const isBlind = state.level !== "ok" && state.level !== "slow";
    el("drive-where").textContent = live.ended ? "no alarm comes any more" : isBlind ? "alarms are not known" : unbroken(place ?? none);
    const side = alarm ? `${fixed(Math.abs(aside), 1)} m ${aside < 0 ? "left" : "right"}, ` : "";
    const speed = live.speed === null ? "speed not known" : `at ${fixed(3.6 * live.speed, 0)} km/h${live.measured === null ? " as stated" : ""}`;
    el("drive-aside").textContent = isBlind ? "" : unbroken(side + speed);
    const known = alarm && live.alarms.get(alarm.id);
    const unlike = live.unlike.length > 0;
    const chance = known ? chances(known) : "";
    el("drive-chances").classList.toggle("unlike", unlike);
    el("drive-chances").textContent = isBlind ? "" : unlike ? "Ground unlike the training: p does not hold" : chance;
    el("drive-prior").textContent = isBlind ? "" : live.changes ? CHANGES : !unlike && chance ? PRIOR : "";
    const inTheWay = isBlind || !scene ? [] : scene.places.filter((one) => counts(scene.numbers, one));
    const latest = alarm ?? inTheWay[0] ?? null;
    this.answers.offer(latest);
  }

  /** What the instruction asks for, in numbers. */
  private how({ word, fastest, left, alarm }: Instruction, state: Health): string {
    if (word === "clear") return `to ${fixed(fastest ?? 0, 0)} km/h`;
    if (word === "slow") return `at most ${fixed(fastest ?? 0, 0)} km/h`;
    if (word === "brake") return `${fixed(Math.max(left ?? 0, 0), 1)} s left`;
    if (word === "over") return `passed in ${fixed(left ?? 0, 1)} m`;
    return alarm ? "alarm ahead" : state.words.toLowerCase() || "nothing known yet";
  }

  private ring(instruction: Instruction, scene: Scene | null, state: Health): void {
    if (document.hidden) return; // the browser lets a page in the background look at its clock only now and then
    const { live, sound } = this;
    if (live.runs !== this.runs) [this.runs, this.known] = [live.runs, null]; // of a run begun anew none is known
    if (state.level === "over" || state.level === "wait") return; // nothing ahead is known any more, or yet
    const names = scene ? scene.places.filter((one) => counts(scene.numbers, one)).map(({ id }) => id) : [];
    const fresh = this.known !== null && names.some((name) => !this.known!.has(name));
    if (live.caughtUp) this.known = new Set([...(this.known ?? []), ...names]);
    const { word } = instruction;
    if (state.level === "lost") sound.play(220, 0.5, 0.3);
    else if (word === "brake" || word === "stop") sound.play(1200, 0.12, 0.12);
    else if (state.level === "slow") sound.play(220, 0.5, 0.3);
    else if (fresh) sound.play(880, 0.25, 0);
  }
}

const STOP: Instruction = { word: "stop", fastest: null, left: null, alarm: null };
