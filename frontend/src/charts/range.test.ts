import { describe, expect, it } from "vitest";
import { decadeRange, roundStep, steadyRange } from "./range";

const BEFORE = { min: -10, max: 10 };

describe("steadyRange", () => {
  it("holds still while the curves fit and use enough of it", () => {
    expect(steadyRange(BEFORE, { minimum: -4, maximum: 7 }, 1)).toBe(BEFORE);
  });

  it("widens at once and covers everything", () => {
    const range = steadyRange(BEFORE, { minimum: -4, maximum: 33 }, 1);
    expect(range.min).toBeLessThanOrEqual(-4);
    expect(range.max).toBeGreaterThanOrEqual(33);
  });

  it("narrows when most of it is unused, but not below the least height", () => {
    const range = steadyRange(BEFORE, { minimum: 1, maximum: 1.001 }, 2);
    expect(range.max - range.min).toBeGreaterThanOrEqual(2);
    expect(range.max - range.min).toBeLessThan(6);
    expect(steadyRange(range, { minimum: 1, maximum: 1.002 }, 2)).toBe(range);
  });

  it("takes a flat curve off the edge, and then holds still", () => {
    // 30 degrees held, on an axis that was made for a step from 22
    const before = { min: 22, max: 30 };
    const range = steadyRange(before, { minimum: 30, maximum: 30 }, 4);
    const share = (30 - range.min) / (range.max - range.min);
    expect(share).toBeGreaterThan(0.25);
    expect(share).toBeLessThan(0.75);
    expect(steadyRange(range, { minimum: 29.98, maximum: 30.02 }, 4)).toBe(range);
    // a curve that uses the whole axis may touch its ends
    expect(steadyRange(before, { minimum: 22, maximum: 30 }, 4)).toBe(before);
  });

  it("keeps what it had when there is nothing to show", () => {
    const nothing = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
    expect(steadyRange(BEFORE, nothing, 1)).toBe(BEFORE);
  });
});

it("rounds steps up to 1, 2, 5 times a power of ten", () => {
  expect([0.9, 1, 1.1, 2.4, 7, 0.03].map(roundStep)).toEqual([1, 1, 2, 5, 10, 0.05]);
});

describe("the decades of a logarithmic axis", () => {
  it("take in all values, in whole powers of ten", () => {
    const [low, high] = decadeRange(0.02, 3);
    expect([low, high]).toEqual([0.01, 10]);
  });

  it("leave out what is rounding, and are there when nothing is", () => {
    const [low, high] = decadeRange(1e-40, 1);
    expect(high / low).toBeCloseTo(1e12, -3);
    for (const [min, max] of [
      [null, null],
      [0, 0],
      [5, 5],
      [1, 1],
    ] as const) {
      const range = decadeRange(min, max);
      expect(range[1] / range[0]).toBeGreaterThan(9);
      expect(Number.isFinite(range[1])).toBe(true);
    }
  });
});
