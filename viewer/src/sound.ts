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
