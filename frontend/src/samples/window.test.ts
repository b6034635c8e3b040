import { describe, expect, it } from "vitest";
import type { Frame } from "../wire/liveMessages";
import { gridOver, pointCount, writeValues } from "./decimate";
import { SampleWindow } from "./window";

describe("window", () => {
  function frame(firstTick: number, values: number[]): Frame {
    return { firstTick, count: values.length, missed: 0, columns: [Float32Array.from(values)] };
  }

  function ramp(firstTick: number, count: number): Frame {
    return frame(
      firstTick,
      Array.from({ length: count }, (_, index) => firstTick + index),
    );
  }

  describe("SampleWindow", () => {
    it("stores samples up to its capacity and drops the oldest", () => {
      const window = new SampleWindow(["q"], 64);
      for (let tick = 0; tick < 200; tick += 10) window.append(ramp(tick, 10));
      expect(window.endTick).toBe(200);
      expect(window.at("q", 199)).toBe(199);
      expect(window.at("q", window.startTick)).toBe(window.startTick);
      expect(window.at("q", window.startTick - 1)).toBeNaN();
      expect(window.length).toBeGreaterThanOrEqual(48);
      expect(window.length).toBeLessThanOrEqual(64);
    });

    it("shows missed samples as a gap", () => {
      const window = new SampleWindow(["q"], 64);
      window.append(ramp(0, 5));
      window.append(ramp(8, 2));
      expect([4, 5, 6, 7, 8].map((tick) => window.at("q", tick))).toEqual([
        4,
        Number.NaN,
        Number.NaN,
        Number.NaN,
        8,
      ]);
    });

    it("accepts the history again after a reconnection without duplicates", () => {
      const window = new SampleWindow(["q"], 64);
      window.append(ramp(0, 30));
      window.append(frame(20, [-1, -2, -3]));
      expect(window.endTick).toBe(23);
      expect(window.at("q", 19)).toBe(19);
      expect(window.at("q", 22)).toBe(-3);
      window.append(ramp(23, 2));
      expect(window.at("q", 24)).toBe(24);
    });

    it("restarts after a restart of the loop, and after a gap longer than its capacity", () => {
      const window = new SampleWindow(["q"], 64);
      window.append(ramp(1000, 10));
      window.append(ramp(0, 4));
      expect([window.startTick, window.endTick]).toEqual([0, 4]);
      window.append(ramp(5000, 4));
      expect([window.startTick, window.endTick]).toEqual([5000, 5004]);
    });

    it("accepts a frame longer than its capacity", () => {
      const window = new SampleWindow(["q"], 64);
      window.append(ramp(0, 300));
      expect(window.newest("q")).toBe(299);
      expect(window.at("q", window.startTick)).toBe(window.startTick);
    });

    it("rejects unknown signals and capacities other than a power of two", () => {
      expect(new SampleWindow(["q"], 64).at("S", 0)).toBeNaN();
      expect(() => new SampleWindow(["q"], 100)).toThrow(/power of two/);
    });
  });
});

describe("window.combined", () => {
  const NAMES = ["q", "q_ref", "theta_A", "theta_B"];
  const LENGTHS = { r_m: 0.0075, r_j: 0.075 };

  /** Values of each column at a tick; the reference is missing at first. */
  function at(tick: number): number[] {
    return [Math.sin(tick / 40), tick < 100 ? Number.NaN : 0.3, tick / 10, -tick / 20].map(Math.fround);
  }

  function filled(
    parts: readonly (readonly [first: number, count: number])[],
    capacity = 4096,
  ): SampleWindow {
    const window = new SampleWindow(NAMES, capacity);
    for (const [firstTick, count] of parts) {
      const rows = Array.from({ length: count }, (_, row) => at(firstTick + row));
      const columns = NAMES.map((_, index) => Float32Array.from(rows, (row) => row[index] as number));
      window.append({ firstTick, count, missed: 0, columns });
    }
    return window;
  }

  /** The expected sums, written as formulas. */
  function plainly(name: string, tick: number): number {
    const [q, q_ref, theta_A, theta_B] = at(tick) as [number, number, number, number];
    if (name === "x_A") return LENGTHS.r_m * theta_A - LENGTHS.r_j * q;
    if (name === "x_B") return LENGTHS.r_m * theta_B + LENGTHS.r_j * q;
    return q - q_ref;
  }

  describe("signals that follow from columns", () => {
    it("have a value at every sample, unless a column has none", () => {
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

    it("are the same if the geometry arrives before or after the samples", () => {
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

    it("are drawn with the extremes of the sums, also after the ring buffer wraps", () => {
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

    it("are omitted if a column is not streamed", () => {
      expect([...new SampleWindow(["q"], 64).columns.keys()]).toEqual(["q"]);
    });
  });
});
