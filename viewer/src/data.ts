import type { Choice, Detection, Index, Layer, Score, Source } from "./types";

/** Half floats to numbers, by table: 65,536 entries. */
export const HALF = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    const value =
      exponent === 0 ? fraction * 2 ** -24 : exponent === 31 ? (fraction ? NaN : Infinity) : (1 + fraction / 1024) * 2 ** (exponent - 15);
    table[bits] = bits & 0x8000 ? -value : value;
  }
  return table;
})();

export async function getJson<T>(path: string, signal?: AbortSignal): Promise<T> {
  const answer = await fetch(path, signal ? { signal } : {});
  const content = await answer.json().catch(() => null);
  if (!answer.ok) throw new Error(content?.error ?? `${path}: ${answer.status}`);
  return content as T;
}

async function getHalves(path: string): Promise<Uint16Array> {
  const answer = await fetch(path);
  if (!answer.ok) {
    const content = await answer.json().catch(() => null);
    throw new Error(content?.error ?? `${path}: ${answer.status}`);
  }
  return new Uint16Array(await answer.arrayBuffer());
}

export async function loadSources(titles: string[], identities: string[]): Promise<Source[]> {
  return Promise.all(
    titles.map(async (title, id) => {
      const [index, score] = await Promise.all([
        getJson<Index>(`data/${id}/index.json`),
        getJson<Score | null>(`data/${id}/score.json`),
      ]);
      return { id, title, identity: identities[id] ?? "", index, score };
    }),
  );
}

export function layerNumber(source: Source, choice: Choice): number {
  return source.index.layers.findIndex(
    (one) => one.detection === choice.set && one.polarization === choice.polarization && one.subband === choice.subband,
  );
}

export function layerOf(source: Source, choice: Choice): Layer | undefined {
  return source.index.layers[layerNumber(source, choice)];
}

/** The detection whose alarms belong to a set of run-views: the first for "before". */
export function detectionOf(source: Source, set: string): Detection | undefined {
  return source.index.detections.find((one) => one.name === set) ?? source.index.detections[0];
}

/** The set of run-views of an earlier drive. */
export const EARLIER = "earlier";

/** What a set of run-views is called on the page: variants by their names, the others by what they show. */
export function setLabel(source: Source, name: string): string {
  const { detections, layers } = source.index;
  const stage = layers.find((one) => one.detection === name)?.stage.replace("clutter ", "");
  return stage && (name === "before" || name === EARLIER || name === detections[0]?.name) ? stage : name;
}

const MOST_TILES = 600;
/** The half float of ground that no scan has seen: not a number. */
export const UNSEEN = 0x7e00;

/** Tiles as they came, the least recently used forgotten first. */
export class Tiles {
  private readonly held = new Map<string, Uint16Array | null>();
  private readonly failed = new Set<string>();
  private waiting = 0;

  constructor(
    private readonly arrived: () => void,
    private readonly complain: (error: Error) => void,
    private readonly busy: (waiting: boolean) => void = () => {},
  ) {}

  get(source: number, layer: number, level: number, tile: number): Uint16Array | null {
    const key = `data/${source}/tile/${layer}/${level}/${tile}`;
    const tileData = this.held.get(key);
    if (tileData) {
      this.held.delete(key);
      this.held.set(key, tileData);
      return tileData;
    }
    if (tileData === undefined && !this.failed.has(key)) void this.fetch(key);
    return null;
  }

  peek(source: number, layer: number, level: number, tile: number): Uint16Array | null {
    return this.held.get(`data/${source}/tile/${layer}/${level}/${tile}`) ?? null;
  }

  /** Take rows of a run-view that grows; gives the tiles that changed. */
  put(source: number, layer: number, row: number, nx: number, tileRows: number, values: Uint16Array): number[] {
    const changed: number[] = [];
    const end = row + values.length / nx;
    for (let tile = Math.floor(row / tileRows); tile * tileRows < end; tile++) {
      const key = `data/${source}/tile/${layer}/0/${tile}`;
      const data = this.held.get(key) ?? new Uint16Array(tileRows * nx).fill(UNSEEN);
      const first = Math.max(row, tile * tileRows);
      const last = Math.min(end, (tile + 1) * tileRows);
      data.set(values.subarray((first - row) * nx, (last - row) * nx), (first - tile * tileRows) * nx);
      this.held.set(key, data);
      changed.push(tile);
    }
    return changed;
  }

  /** Forget what came of a source. */
  drop(source: number): void {
    for (const key of [...this.held.keys()]) if (key.startsWith(`data/${source}/`)) this.held.delete(key);
  }

  private async fetch(key: string): Promise<void> {
    this.held.set(key, null);
    this.busy(++this.waiting > 0);
    try {
      this.held.set(key, await getHalves(key));
      for (const old of this.held.keys()) {
        if (this.held.size <= MOST_TILES) break;
        if (this.held.get(old)) this.held.delete(old);
      }
      this.arrived();
    } catch (error) {
      this.held.delete(key);
      this.failed.add(key);
      this.complain(error as Error);
    } finally {
      this.busy(--this.waiting > 0);
    }
  }
}

export async function loadEvidence(source: number, detection: number, alarm: number): Promise<Float32Array> {
  const halves = await getHalves(`data/${source}/evidence/${detection}/${alarm}`);
  return Float32Array.from(halves, (bits) => HALF[bits]!);
}
