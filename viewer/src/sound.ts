import { fixed } from "./dom";
import type { Instruction } from "./instruct";

/** Tones of the driver's screen: off until they are switched on, for a browser lets no page sound before it is touched. */
export class Sound {
  on = false;
  private context: AudioContext | null = null;
  private silentUntil = 0;

  async toggle(): Promise<void> {
    this.on = !this.on;
    if (!this.on) return;
    this.context ??= new AudioContext();
    await this.context.resume();
    this.silentUntil = 0;
    this.play(880, 0.15, 0);
  }

  /** A tone, unless one sounds; the next may come after `pause` seconds. */
  play(hertz: number, length: number, pause: number): void {
    const { context } = this;
    if (!this.on || !context || context.currentTime < this.silentUntil) return;
    const start = context.currentTime;
    this.silentUntil = start + length + pause;
    const [tone, gain] = [context.createOscillator(), context.createGain()];
    tone.frequency.value = hertz;
    gain.gain.setValueAtTime(0.6, start);
    gain.gain.linearRampToValueAtTime(0, start + length);
    tone.connect(gain).connect(context.destination);
    tone.start(start);
    tone.stop(start + length);
  }
}

const SPOKEN = { clear: "Clear", slow: "Slow", brake: "Brake", stop: "Stop", over: "Over an alarm" };
/** A lower speed is said again once it has fallen by so much, km/h. */
const FALLEN = 3;

/** The instruction as speech, by the browser's own voice: off until it is switched on. */
export class Voice {
  on = false;
  private said: Instruction | null = null;

  get exists(): boolean {
    return "speechSynthesis" in window;
  }

  toggle(): void {
    this.on = !this.on;
    this.said = null;
    if (!this.on) speechSynthesis.cancel();
  }

  /** Say an instruction that is new, in the place of what is being said. */
  say(instruction: Instruction): void {
    const { said } = this;
    const isLower = instruction.word === "slow" && (said?.fastest ?? 0) - (instruction.fastest ?? 0) >= FALLEN;
    if (!this.on || (said?.word === instruction.word && !isLower)) return;
    this.said = instruction;
    const most = instruction.word === "slow" && instruction.fastest !== null ? `. At most ${fixed(instruction.fastest, 0)}` : "";
    speechSynthesis.cancel();
    const words = new SpeechSynthesisUtterance(SPOKEN[instruction.word] + most);
    words.lang = "en";
    speechSynthesis.speak(words);
  }
}
