import type { Georeference, Lane, Source } from "./types";

/** Latitude and longitude of a lane point on the local tangent plane; good to centimetres within a kilometre. */
export function geographic(reference: Georeference | null): ((x: number, y: number) => [number, number]) | null {
  if (!reference || !Number.isFinite(reference.latitude) || !Number.isFinite(reference.longitude)) return null;
  const azimuth = ((reference.azimuth ?? 0) * Math.PI) / 180;
  const sine = Math.sin((reference.latitude * Math.PI) / 180);
  const [axis, squared] = [6378137, 6.69437999014e-3];
  const root = 1 - squared * sine * sine;
  const [meridian, normal] = [(axis * (1 - squared)) / root ** 1.5, axis / Math.sqrt(root)];
  return (x, y) => {
    const north = y * Math.cos(azimuth) - x * Math.sin(azimuth);
    const east = y * Math.sin(azimuth) + x * Math.cos(azimuth);
    const degrees = 180 / Math.PI;
    return [reference.latitude + (north / meridian) * degrees, reference.longitude + (east / (normal * Math.sqrt(1 - sine * sine))) * degrees];
  };
}

/** All ground that any source shows. */
export function extentOf(sources: Source[]): Lane {
  const found = sources.map(({ index: { grid, lane } }) =>
    grid
      ? { x_min: grid.x - grid.dx / 2, x_max: grid.x + (grid.nx - 0.5) * grid.dx, y_min: grid.y - grid.dy / 2, y_max: grid.y + (grid.ny - 0.5) * grid.dy }
      : lane,
  );
  return {
    x_min: Math.min(...found.map((one) => one.x_min)),
    x_max: Math.max(...found.map((one) => one.x_max)),
    y_min: Math.min(...found.map((one) => one.y_min)),
    y_max: Math.max(...found.map((one) => one.y_max)),
  };
}
