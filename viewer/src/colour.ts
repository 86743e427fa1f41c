import { COLOUR_MAPS } from "./colormaps";
import { HALF } from "./data";

export interface Colours { map: string; floor: number; range: number }

function anchors(map: string): [number, number, number][] {
  const hex = COLOUR_MAPS[map] ?? COLOUR_MAPS["viridis"]!;
  return Array.from({ length: hex.length / 6 }, (_, i) => {
    const value = parseInt(hex.slice(6 * i, 6 * i + 6), 16);
    return [value >> 16, (value >> 8) & 255, value & 255];
  });
}

export function colourAt(map: string, share: number): [number, number, number] {
  const points = anchors(map);
  const place = Math.min(Math.max(share, 0), 1) * (points.length - 1);
  const low = Math.min(Math.floor(place), points.length - 2);
  const part = place - low;
  return [0, 1, 2].map((i) => Math.round(points[low]![i]! * (1 - part) + points[low + 1]![i]! * part)) as [number, number, number];
}

const SHADES = 256;

/**
 * Colour of every half float, so that a picture is one look-up per pixel. `reference` is the dB value that counts as 0.
 */
export function colourTable(colours: Colours, reference: number): Uint32Array {
  const shades = new Uint32Array(SHADES);
  for (let i = 0; i < SHADES; i++) {
    const [r, g, b] = colourAt(colours.map, i / (SHADES - 1));
    shades[i] = (255 << 24) | (b << 16) | (g << 8) | r;
  }
  const table = new Uint32Array(65536);
  const low = reference + colours.floor;
  const scale = (SHADES - 1) / colours.range;
  for (let bits = 0; bits < 65536; bits++) {
    const value = HALF[bits]!;
    if (value !== value) continue;
    const shade = Math.round((value - low) * scale);
    table[bits] = shades[shade < 0 ? 0 : shade > 255 ? 255 : shade]!;
  }
  return table;
}
