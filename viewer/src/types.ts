export interface Grid { x: number; y: number; nx: number; ny: number; dx: number; dy: number }
export interface Lane { x_min: number; x_max: number; y_min: number; y_max: number }
export interface Layer {
  detection: string;
  stage: string;
  polarization: string;
  subband: string;
  percentiles: Record<string, number>;
  levels: { file: string; rows: number }[];
}
export type Columns = Record<string, (number | null)[]>;
export interface Evidence {
  polarization: string[];
  subband: string[];
  patch: { size: number; spacing: number; inner: [number, number]; guard: [number, number] };
  cut: number[];
  trace: number[];
  start: number[];
  scans: { scan: number; distance: number }[][];
  polarimetric: Columns;
  /** Where the map tells: what each look's value is made of, and what explains it alone, by alarm and look, nearest first: scan, distance, share of the weight, then a value each. */
  adds?: string[];
  alone?: string[];
  causes?: (number | null)[][][];
}
export interface Training { label: string; count: number; shares: number[]; quantiles: Record<string, (number | null)[]> }
export interface Detection {
  name: string;
  title: string;
  alarms: { alarm_id?: string[]; x: number[]; y: number[]; confidence: number[] };
  features: Columns;
  contributions: Columns | null;
  training: Training[] | null;
  evidence?: Evidence;
  /** Confidence from which a detector that has learnt decides for a mine. */
  border?: number | null;
}
export interface Georeference { latitude: number; longitude: number; azimuth?: number }
export interface Index {
  title: string;
  lane: Lane;
  grid: Grid | null;
  tile_rows: number;
  channel: [string, string];
  /** A score alone: no lane, no alarms. */
  scored?: boolean;
  layers: Layer[];
  scans: { x: number[]; y: number[]; z: number[]; heading: number[]; masked: number[] };
  /** How far ahead of the array a scan gives to the run-view, m; results of before it was written do not tell. */
  sight?: [number, number];
  /** Whether the images are of all scans, taken as one aperture. */
  aperture?: boolean;
  georeference: Georeference | null;
  /** What is said of ground that is unlike that of the model's training, or that nobody can tell. */
  unlike?: string[];
  /** How many alarms of the first detection stand out, how that was found and what is advised, and the confidence from which on. */
  stands_out?: { border: number | null; notes: string[] };
  detections: Detection[];
  run?: { polarizations: string[]; pairs: number; tones: number; frequency_hz: [number, number]; notes: string[]; recording: boolean };
}
export interface Curve {
  kind: string | null;
  depth: string | null;
  n_targets: number;
  area: number;
  level: number;
  pd_mean: number | null;
  threshold: (number | null)[];
  pd: (number | null)[];
  far: number[];
  n_detected: number[];
  n_false: number[];
  pd_low: (number | null)[];
  pd_high: (number | null)[];
  /** Pd of alarms that know nothing of the targets; scores of before it was known have none. */
  chance?: (number | null)[];
  /** Where targets count as found: the row, the rate asked for and the one allowed, which a small lane raises; how many halos there is room for, if few. */
  point?: { row: number; far_asked: number; far_allowed: number; few_halos: number | null };
  far_low: number[];
  far_high: number[];
  /** Rates that the rows were told for, where nobody told thresholds. */
  allowed?: number[];
}
type Shared = "area" | "level" | "point" | "threshold" | "far" | "n_false" | "far_low" | "far_high";
export interface Scored {
  label: string[];
  target: number[];
  distance: (number | null)[];
  outcomes: Record<string, unknown[]>;
  /** What all subsets have in common: thresholds and false alarms. */
  shared: Pick<Curve, Shared>;
  curves: Omit<Curve, Shared>[];
  /** Of a score alone: operating points by group of targets, and what became of each target. */
  points?: ScoredPoint[];
  targets?: ScoredTarget[];
}
export interface ScoredTarget { target_id: string; kind: string; depth: number | null; far: number | null; confidence: number | null }
export interface ScoredPoint {
  group: string;
  far_allowed: number;
  n_detected: number;
  n_targets: number;
  n_false: number;
  pd: number | null;
  pd_low: number | null;
  pd_high: number | null;
  chance: number | null;
}
export interface Targets { target_id: string[]; x: number[]; y: number[]; kind: string[]; depth: (number | null)[] }
export interface Objects { object_id: string[]; x: number[]; y: number[]; kind: string[] }
export interface Score {
  halo: number;
  truth: Targets;
  objects: Objects | null;
  kinds: string[];
  depths: string[];
  target_depth: (string | null)[];
  detections: Record<string, Scored>;
  /** Of a score alone: by which rules, and against which truth. */
  rules?: Record<string, unknown>;
}
export interface Source { id: number; title: string; identity: string; index: Index; score: Score | null }
/** One channel of one set of run-views: what a picture shows. */
export interface Choice { source: number; set: string; polarization: string; subband: string }
/** How the choices A and B share the picture. */
export type Compare = "off" | "swipe" | "blink";
export type Verdict = "" | "mine" | "unsure" | "clutter";
export interface Note { verdict: Verdict; text: string }
