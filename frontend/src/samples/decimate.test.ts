import { describe, expect, it } from "vitest";
import {
  atOrBefore,
  bucketTicks,
  gridOver,
  pointCount,
  pointTimes,
  pointValues,
  writeTimes,
  writeValues,
} from "./decimate";
import { SampleWindow } from "./window";

describe("decimate", () => {
  const LENGTH = 4000;

  /** Noise that is the same in each run. */
  function noise(length: number): number[] {
    let seed = 12345;
    return Array.from({ length }, () => {
      seed = (1103515245 * seed + 12345) % 2 ** 31;
      return Math.fround(seed / 2 ** 31 - 0.5);
    });
  }

  function filled(values: number[], firstTick = 0): SampleWindow {
    const window = new SampleWindow(["q"], 8192);
    for (let from = 0; from < values.length; from += 33) {
      const part = values.slice(from, from + 33);
      window.append({
        firstTick: firstTick + from,
        count: part.length,
        missed: 0,
        columns: [Float32Array.from(part)],
      });
    }
    return window;
  }

  function curve(window: SampleWindow, from: number, to: number, pixels: number, factor = 1) {
    const grid = gridOver(window, from, to, pixels);
    const times = new Float64Array(pointCount(grid));
    const values = new Float64Array(pointCount(grid));
    writeTimes(grid, 0.001, times);
    const extent = writeValues(window, "q", grid, factor, values);
    return { grid, times: Array.from(times), values: Array.from(values), extent };
  }

  describe("bucketTicks", () => {
    it("returns two to four points per pixel if there are more samples", () => {
      for (const span of [5000, 10_000, 20_000, 30_000, 60_000, 120_000]) {
        const points = (2 * span) / bucketTicks(span, 700);
        expect(points / 700).toBeGreaterThanOrEqual(2);
        expect(points / 700).toBeLessThanOrEqual(4);
      }
    });

    it("returns raw samples for short time ranges", () => {
      expect(bucketTicks(1400, 700)).toBe(1);
      expect(bucketTicks(20, 700)).toBe(1);
    });
  });

  describe("writeValues", () => {
    it("preserves every extreme, compared with a plain search", () => {
      const values = noise(LENGTH);
      const window = filled(values);
      for (const pixels of [20, 50, 300]) {
        const { grid, values: points, extent } = curve(window, 100, 3900, pixels);
        expect(grid.bucket).toBeGreaterThan(1);
        for (let index = 0; index < grid.buckets; index++) {
          const from = grid.fromTick + index * grid.bucket;
          const slice = values.slice(from, from + grid.bucket);
          const pair = points.slice(2 * index, 2 * index + 2);
          expect(Math.min(...pair)).toBe(Math.min(...slice));
          expect(Math.max(...pair)).toBe(Math.max(...slice));
        }
        expect(extent).toEqual({ minimum: Math.min(...points), maximum: Math.max(...points) });
      }
    });

    it("returns the same points of a time range while the view scrolls", () => {
      const window = filled(noise(LENGTH));
      const before = curve(window, 0, 3000, 60);
      const after = curve(window, 317, 3317, 60);
      const common = before.times.filter((time) => time >= 0.4 && time < 2.9);
      expect(common.length).toBeGreaterThan(40);
      for (const time of common) {
        expect(after.values[after.times.indexOf(time)]).toBe(before.values[before.times.indexOf(time)]);
      }
    });

    it("returns extremes in the order of the motion", () => {
      const rising = curve(filled(Array.from({ length: LENGTH }, (_, tick) => tick)), 0, LENGTH, 20).values;
      expect(rising).toEqual([...rising].sort((a, b) => a - b));
      const falling = curve(filled(Array.from({ length: LENGTH }, (_, tick) => -tick)), 0, LENGTH, 20).values;
      expect(falling).toEqual([...falling].sort((a, b) => b - a));
    });

    it("returns raw samples when zoomed in, in the requested unit", () => {
      const values = noise(LENGTH);
      const { grid, times, values: points } = curve(filled(values), 1000, 1050, 700, 2);
      expect(grid.bucket).toBe(1);
      expect(times[0]).toBeCloseTo(1.0, 9);
      expect(points[0]).toBe(2 * (values[1000] as number));
      expect(points).toHaveLength(51);
    });

    it("has gaps at missing buckets, and no points beyond the window", () => {
      const window = filled(noise(500));
      const late = noise(500);
      window.append({ firstTick: 2000, count: 500, missed: 1500, columns: [Float32Array.from(late)] });
      const { times, values } = curve(window, -1000, 9000, 20);
      expect(times[0]).toBe(0);
      expect(times.at(-1)).toBeLessThan(2.6);
      expect(values.some(Number.isNaN)).toBe(true);
      expect(values.filter((value) => !Number.isNaN(value)).length).toBeGreaterThan(0);
    });

    it("is empty for an unknown signal", () => {
      const window = filled(noise(100));
      const grid = gridOver(window, 0, 100, 10);
      const out = new Float64Array(pointCount(grid));
      const extent = writeValues(window, "S", grid, 1, out);
      expect(out.every(Number.isNaN)).toBe(true);
      expect(extent.maximum).toBeLessThan(extent.minimum);
    });
  });
});

describe("envelope", () => {
  const floats = (...values: number[]) => Float32Array.from(values);
  const ENVELOPE = {
    raw: false,
    width_s: 1,
    t: Float64Array.of(0, 1, 2),
    signals: { q: { minimum: floats(0, -2, 5), maximum: floats(1, 3, 9) } },
  };

  describe("an envelope", () => {
    it("has two points per bucket, in the order of the motion", () => {
      expect(Array.from(pointTimes(ENVELOPE))).toEqual([0, 0.5, 1, 1.5, 2, 2.5]);
      const { values, extent } = pointValues(ENVELOPE, "q", 10);
      expect(Array.from(values)).toEqual([0, 10, 30, -20, 50, 90]);
      expect(extent).toEqual({ minimum: -20, maximum: 90 });
    });

    it("has gaps for missing samples and for an unknown signal", () => {
      const holed = {
        ...ENVELOPE,
        signals: { q: { minimum: floats(0, Number.NaN, 5), maximum: floats(1, Number.NaN, 9) } },
      };
      expect(Array.from(pointValues(holed, "q", 1).values.slice(2, 4))).toEqual([Number.NaN, Number.NaN]);
      expect(pointValues(ENVELOPE, "S", 1).values.every(Number.isNaN)).toBe(true);
    });
  });

  it("returns one point for each raw sample", () => {
    const raw = { ...ENVELOPE, raw: true };
    expect(Array.from(pointTimes(raw))).toEqual([0, 1, 2]);
    expect(Array.from(pointValues(raw, "q", 1).values)).toEqual([0, -2, 5]);
  });

  it("finds the last time at or before a time", () => {
    const times = [0, 1, 2, 5];
    expect([-3, 0, 0.6, 0.9999, 3.4, 5, 99].map((wanted) => atOrBefore(times, wanted))).toEqual([
      -1, 0, 0, 1, 2, 3, 3,
    ]);
    expect(atOrBefore([4], 3)).toBe(-1);
    expect(atOrBefore([4], 100)).toBe(0);
    const ticks = Float64Array.from({ length: 1000 }, (_, tick) => tick * 0.001);
    expect([0.3, 0.299, 0.7].map((wanted) => atOrBefore(ticks, wanted))).toEqual([300, 299, 700]);
  });
});
