import { describe, expect, it } from "vitest";
import { gridOver, pointCount, writeValues } from "./decimate";
import { SampleWindow } from "./window";

const NAMES = ["q", "q_ref", "theta_A", "theta_B"];
const LENGTHS = { r_m: 0.0075, r_j: 0.075 };

/** Values of each column at a tick; the reference is missing at first. */
function at(tick: number): number[] {
  return [Math.sin(tick / 40), tick < 100 ? Number.NaN : 0.3, tick / 10, -tick / 20].map(Math.fround);
}

function filled(parts: readonly (readonly [first: number, count: number])[], capacity = 4096): SampleWindow {
  const window = new SampleWindow(NAMES, capacity);
  for (const [firstTick, count] of parts) {
    const rows = Array.from({ length: count }, (_, row) => at(firstTick + row));
    const columns = NAMES.map((_, index) => Float32Array.from(rows, (row) => row[index] as number));
    window.append({ firstTick, count, missed: 0, columns });
  }
  return window;
}

/** Written out by hand. */
function plainly(name: string, tick: number): number {
  const [q, q_ref, theta_A, theta_B] = at(tick) as [number, number, number, number];
  if (name === "x_A") return LENGTHS.r_m * theta_A - LENGTHS.r_j * q;
  if (name === "x_B") return LENGTHS.r_m * theta_B + LENGTHS.r_j * q;
  return q - q_ref;
}

describe("signals that follow from columns", () => {
  it("are there at every sample, and missing where a part of them is", () => {
    const window = filled([
      [0, 333],
      [333, 41],
      [500, 200],
    ]);
    window.measure(LENGTHS);
    for (const name of ["q - q_ref", "x_A", "x_B"]) {
      for (let tick = 0; tick < 700; tick++) {
        const hole = tick >= 374 && tick < 500;
        const wanted = hole ? Number.NaN : plainly(name, tick);
        if (Number.isNaN(wanted)) expect(window.at(name, tick)).toBeNaN();
        else expect(window.at(name, tick)).toBeCloseTo(wanted, 6);
      }
    }
  });

  it("are the same whether the geometry was known before the samples or after them", () => {
    const late = filled([[0, 700]]);
    expect(late.at("x_A", 50)).toBeNaN();
    late.measure(LENGTHS);
    const early = new SampleWindow(NAMES, 4096);
    early.measure(LENGTHS);
    const rows = Array.from({ length: 700 }, (_, tick) => at(tick));
    const columns = NAMES.map((_, index) => Float32Array.from(rows, (row) => row[index] as number));
    early.append({ firstTick: 0, count: 700, missed: 0, columns });
    for (let tick = 0; tick < 700; tick++) expect(late.at("x_A", tick)).toBe(early.at("x_A", tick));
  });

  it("are drawn with the extremes of the sums, after the window has gone round too", () => {
    const window = filled(
      Array.from({ length: 30 }, (_, n) => [n * 33, 33] as const),
      512,
    );
    window.measure(LENGTHS);
    const grid = gridOver(window, 500, 980, 20);
    const points = new Float64Array(pointCount(grid));
    writeValues(window, "q - q_ref", grid, 1, points);
    expect(grid.bucket).toBeGreaterThan(1);
    for (let bucket = 0; bucket < grid.buckets; bucket++) {
      const from = Math.max(grid.fromTick + bucket * grid.bucket, window.startTick);
      const to = Math.min(grid.fromTick + (bucket + 1) * grid.bucket, window.endTick);
      const values = Array.from({ length: to - from }, (_, n) => plainly("q - q_ref", from + n));
      const pair = [...points.slice(2 * bucket, 2 * bucket + 2)];
      expect(Math.min(...pair)).toBeCloseTo(Math.min(...values), 6);
      expect(Math.max(...pair)).toBeCloseTo(Math.max(...values), 6);
    }
  });

  it("are left out where a column is not streamed", () => {
    expect([...new SampleWindow(["q"], 64).columns.keys()]).toEqual(["q"]);
  });
});
