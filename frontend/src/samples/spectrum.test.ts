import { describe, expect, it } from "vitest";
import { longestWhole, welch } from "./spectrum";

const PERIOD_S = 0.001;

function sine(amplitude: number, frequency: number, length: number): Float64Array {
  return Float64Array.from(
    { length },
    (_, k) => 3 + amplitude * Math.sin(2 * Math.PI * frequency * k * PERIOD_S),
  );
}

describe("welch", () => {
  it("reads amplitude and frequency of a sine on a bin", () => {
    const frequency = 64 / (2048 * PERIOD_S);
    const spectrum = welch(sine(0.7, frequency, 5000), PERIOD_S);
    const values = Array.from(spectrum?.amplitude ?? []);
    const peak = values.indexOf(Math.max(...values));
    expect(spectrum?.frequencies[peak]).toBeCloseTo(frequency, 9);
    expect(values[peak]).toBeCloseTo(0.7, 6);
  });

  it("keeps the power: the density over all frequencies is the variance", () => {
    // a linear congruential generator: white, and the same in each run
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

  it("has nothing to say of a few samples", () => {
    expect(welch(sine(1, 10, 60), PERIOD_S)).toBeNull();
  });
});

describe("longestWhole", () => {
  it("is the longest stretch between missing samples", () => {
    const nan = Number.NaN;
    expect(Array.from(longestWhole(Float64Array.from([1, nan, 2, 3, 4, nan, 5])))).toEqual([2, 3, 4]);
    expect(longestWhole(new Float64Array(0))).toHaveLength(0);
  });
});
