import { describe, expect, it } from "vitest";
import { statistics } from "./statistics";

const column = (minimum: number[], maximum = minimum) => ({
  name: "q",
  minimum: Float64Array.from(minimum),
  maximum: Float64Array.from(maximum),
});

describe("statistics", () => {
  it("gives extremes, mean and deviation of raw samples, without the missing ones", () => {
    const figures = statistics(column([2, 4, Number.NaN, 4, 4, 5, 5, 7, 9]), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
    expect(figures).toEqual({ minimum: 2, minimum_s: 1, maximum: 9, maximum_s: 9, mean: 5, deviation: 2 });
  });

  it("keeps its precision far from zero", () => {
    expect(statistics(column([1e9 + 1, 1e9 + 3]), [0, 1]).deviation).toBeCloseTo(1, 9);
  });

  it("takes the exact extremes of an envelope", () => {
    const figures = statistics(column([-1, 0], [3, 8]), [10, 11]);
    expect([figures.minimum, figures.maximum, figures.mean]).toEqual([-1, 8, 2.5]);
    expect([figures.minimum_s, figures.maximum_s]).toEqual([10, 11]);
  });

  it("says where an extreme is first", () => {
    const figures = statistics(column([5, 1, 7, 1, 7]), [0, 0.5, 1, 1.5, 2]);
    expect([figures.minimum_s, figures.maximum_s]).toEqual([0.5, 1]);
  });

  it("is NaN without any number", () => {
    expect(statistics(column([Number.NaN]), [0]).minimum).toBeNaN();
  });
});
