import { describe, expect, it } from "vitest";
import { figuresOf, longestWhole, spectraOf, statistics, welch } from "./analysis";

describe("statistics", () => {
  const column = (minimum: number[], maximum = minimum) => ({
    name: "q",
    minimum: Float64Array.from(minimum),
    maximum: Float64Array.from(maximum),
  });

  describe("statistics", () => {
    it("returns extremes, mean and deviation of raw samples, and counts the missing ones", () => {
      const samples = column([2, 4, Number.NaN, 4, 4, 5, 5, 7, 9]);
      const figures = statistics(samples, [1, 2, 3, 4, 5, 6, 7, 8, 9], true);
      const extremes = { minimum: 2, minimum_s: 1, maximum: 9, maximum_s: 9 };
      expect(figures).toEqual({ ...extremes, mean: 5, deviation: 2, values: 8, withoutValue: 1 });
    });

    it("preserves its precision far from zero", () => {
      expect(statistics(column([1e9 + 1, 1e9 + 3]), [0, 1], true).deviation).toBeCloseTo(1, 9);
    });

    it("returns exact extremes of an envelope, and no mean or deviation", () => {
      const figures = statistics(column([-1, 0], [3, 8]), [10, 11], false);
      expect([figures.minimum, figures.maximum]).toEqual([-1, 8]);
      expect([figures.mean, figures.deviation]).toEqual([Number.NaN, Number.NaN]);
      expect([figures.minimum_s, figures.maximum_s]).toEqual([10, 11]);
    });

    it("returns the time of the first extreme", () => {
      const figures = statistics(column([5, 1, 7, 1, 7]), [0, 0.5, 1, 1.5, 2], true);
      expect([figures.minimum_s, figures.maximum_s]).toEqual([0.5, 1]);
    });

    it("is NaN without any value", () => {
      const figures = statistics(column([Number.NaN]), [0], true);
      expect(figures.minimum).toBeNaN();
      expect([figures.values, figures.withoutValue]).toEqual([0, 1]);
    });
  });
});

describe("spectrum", () => {
  const PERIOD_S = 0.001;

  function sine(amplitude: number, frequency: number, length: number): Float64Array {
    return Float64Array.from(
      { length },
      (_, k) => 3 + amplitude * Math.sin(2 * Math.PI * frequency * k * PERIOD_S),
    );
  }

  describe("welch", () => {
    it("returns amplitude and frequency of a sine on a bin", () => {
      const frequency = 64 / (2048 * PERIOD_S);
      const spectrum = welch(sine(0.7, frequency, 5000), PERIOD_S);
      const values = Array.from(spectrum?.amplitude ?? []);
      const peak = values.indexOf(Math.max(...values));
      expect(spectrum?.frequencies[peak]).toBeCloseTo(frequency, 9);
      expect(values[peak]).toBeCloseTo(0.7, 6);
    });

    it("preserves the power: the integral of the density is the variance", () => {
      // Linear congruential generator: white, and the same in each run.
      let state = 1;
      const noise = Float64Array.from({ length: 65536 }, () => {
        state = (state * 1664525 + 1013904223) % 2 ** 32;
        return state / 2 ** 32 - 0.5;
      });
      const spectrum = welch(noise, PERIOD_S);
      const step = spectrum?.frequencies[0] ?? 0;
      const power = (spectrum?.density ?? new Float64Array(0)).reduce((sum, value) => sum + value * step, 0);
      expect(power / (1 / 12)).toBeCloseTo(1, 1);
    });

    it("returns null for too few samples", () => {
      expect(welch(sine(1, 10, 60), PERIOD_S)).toBeNull();
    });
  });

  describe("longestWhole", () => {
    it("returns the longest range between missing samples", () => {
      const nan = Number.NaN;
      expect(Array.from(longestWhole(Float64Array.from([1, nan, 2, 3, 4, nan, 5])))).toEqual([2, 3, 4]);
      expect(longestWhole(new Float64Array(0))).toHaveLength(0);
    });
  });
});

describe("statistics and spectra of a table", () => {
  const PERIOD_S = 0.001;
  const t = Float64Array.from({ length: 1000 }, (_, row) => row * PERIOD_S);
  const sine = t.map((time) => Math.sin(2 * Math.PI * 50 * time));
  const holed = sine.map((value, row) => (row < 400 ? Number.NaN : value));
  const column = (name: string, values: Float64Array) => ({ name, minimum: values, maximum: values });
  const raw = { raw: true, width_s: PERIOD_S, t, columns: [column("q", sine), column("S", holed)] };

  it("states the number of samples, and how many have no value", () => {
    const { basis, signals } = figuresOf(raw);
    const range = { from_s: 0, to_s: 0.999 };
    expect(basis).toEqual([{ of: "", range, samples: 1000, missing: 0, bucket_s: null }]);
    expect(signals.get("S")).toMatchObject({ values: 600, withoutValue: 400 });
  });

  it("returns only extremes of an envelope, with the length of its buckets", () => {
    const { basis, signals } = figuresOf({ ...raw, raw: false, width_s: 0.1 });
    expect(basis[0]?.bucket_s).toBe(0.1);
    expect(signals.get("q")?.mean).toBeNaN();
    expect(signals.get("q")?.maximum).toBeCloseTo(1, 9);
  });

  it("states the samples of a spectrum, and the reason for a missing one", () => {
    const { signals, reasons } = spectraOf(raw, ["q", "S", "F_A"], PERIOD_S);
    expect(signals.get("q")).toMatchObject({
      segment: 256,
      segments: 6,
      used: 896,
      values: 1000,
      withoutValue: 0,
    });
    expect(signals.get("S")).toMatchObject({
      segment: 256,
      segments: 3,
      used: 512,
      values: 600,
      withoutValue: 400,
    });
    expect([...reasons.keys()]).toEqual(["F_A"]);
    expect(spectraOf({ ...raw, raw: false }, ["q"], PERIOD_S).reasons.has("q")).toBe(true);
  });
});
