import { describe, expect, it } from "vitest";
import { merged, resampled } from "./comparedSource";

const row = (...values: number[]) => Float64Array.from(values);

describe("merged", () => {
  it("keeps both rows in order and each time once", () => {
    expect(Array.from(merged(row(0, 1, 3), row(0.5, 1, 4)))).toEqual([0, 0.5, 1, 3, 4]);
    expect(Array.from(merged(row(), row(2)))).toEqual([2]);
  });
});

describe("resampled", () => {
  it("holds the last value and draws nothing outside its own times", () => {
    const values = resampled(row(1, 2), row(10, 20), row(0, 1, 1.5, 2, 3));
    expect(Array.from(values)).toEqual([Number.NaN, 10, 10, 20, Number.NaN]);
  });
});
