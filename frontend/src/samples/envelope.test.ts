import { describe, expect, it } from "vitest";
import { atOrBefore, pointTimes, pointValues } from "./envelope";

const floats = (...values: number[]) => Float32Array.from(values);
const ENVELOPE = {
  raw: false,
  width_s: 1,
  t: Float64Array.of(0, 1, 2),
  signals: { q: { minimum: floats(0, -2, 5), maximum: floats(1, 3, 9) } },
};

describe("an envelope", () => {
  it("becomes two points per bucket, passed in the order of the motion", () => {
    expect(Array.from(pointTimes(ENVELOPE))).toEqual([0, 0.5, 1, 1.5, 2, 2.5]);
    const { values, extent } = pointValues(ENVELOPE, "q", 10);
    expect(Array.from(values)).toEqual([0, 10, 30, -20, 50, 90]);
    expect(extent).toEqual({ minimum: -20, maximum: 90 });
  });

  it("has holes where samples are missing and where the signal is unknown", () => {
    const holed = {
      ...ENVELOPE,
      signals: { q: { minimum: floats(0, Number.NaN, 5), maximum: floats(1, Number.NaN, 9) } },
    };
    expect(Array.from(pointValues(holed, "q", 1).values.slice(2, 4))).toEqual([Number.NaN, Number.NaN]);
    expect(pointValues(ENVELOPE, "S", 1).values.every(Number.isNaN)).toBe(true);
  });
});

it("raw samples stay one point each", () => {
  const raw = { ...ENVELOPE, raw: true };
  expect(Array.from(pointTimes(raw))).toEqual([0, 1, 2]);
  expect(Array.from(pointValues(raw, "q", 1).values)).toEqual([0, -2, 5]);
});

it("finds the time at or before a moment", () => {
  const times = [0, 1, 2, 5];
  expect([-3, 0, 0.6, 0.9999, 3.4, 5, 99].map((wanted) => atOrBefore(times, wanted))).toEqual([
    -1, 0, 0, 1, 2, 3, 3,
  ]);
  expect(atOrBefore([4], 3)).toBe(-1);
  expect(atOrBefore([4], 100)).toBe(0);
  const ticks = Float64Array.from({ length: 1000 }, (_, tick) => tick * 0.001);
  expect([0.3, 0.299, 0.7].map((wanted) => atOrBefore(ticks, wanted))).toEqual([300, 299, 700]);
});
