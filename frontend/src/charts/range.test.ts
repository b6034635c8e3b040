import { describe, expect, it } from "vitest";
import { roundStep, steadyRange } from "./range";

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

  it("keeps what it had when there is nothing to show", () => {
    const nothing = { minimum: Number.POSITIVE_INFINITY, maximum: Number.NEGATIVE_INFINITY };
    expect(steadyRange(BEFORE, nothing, 1)).toBe(BEFORE);
  });
});

it("rounds steps up to 1, 2, 5 times a power of ten", () => {
  expect([0.9, 1, 1.1, 2.4, 7, 0.03].map(roundStep)).toEqual([1, 1, 2, 5, 10, 0.05]);
});
