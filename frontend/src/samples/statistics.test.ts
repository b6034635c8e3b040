import { describe, expect, it } from "vitest";
import { statistics } from "./statistics";

const column = (minimum: number[], maximum = minimum) => ({
  name: "q",
  minimum: Float64Array.from(minimum),
  maximum: Float64Array.from(maximum),
});

describe("statistics", () => {
  it("gives extremes, mean and deviation of raw samples, and counts the missing ones", () => {
    const samples = column([2, 4, Number.NaN, 4, 4, 5, 5, 7, 9]);
    const figures = statistics(samples, [1, 2, 3, 4, 5, 6, 7, 8, 9], true);
    const extremes = { minimum: 2, minimum_s: 1, maximum: 9, maximum_s: 9 };
    expect(figures).toEqual({ ...extremes, mean: 5, deviation: 2, values: 8, withoutValue: 1 });
  });

  it("keeps its precision far from zero", () => {
    expect(statistics(column([1e9 + 1, 1e9 + 3]), [0, 1], true).deviation).toBeCloseTo(1, 9);
  });

  it("takes the exact extremes of an envelope, and no mean or deviation", () => {
    const figures = statistics(column([-1, 0], [3, 8]), [10, 11], false);
    expect([figures.minimum, figures.maximum]).toEqual([-1, 8]);
    expect([figures.mean, figures.deviation]).toEqual([Number.NaN, Number.NaN]);
    expect([figures.minimum_s, figures.maximum_s]).toEqual([10, 11]);
  });

  it("says where an extreme is first", () => {
    const figures = statistics(column([5, 1, 7, 1, 7]), [0, 0.5, 1, 1.5, 2], true);
    expect([figures.minimum_s, figures.maximum_s]).toEqual([0.5, 1]);
  });

  it("is NaN without any number", () => {
    const figures = statistics(column([Number.NaN]), [0], true);
    expect(figures.minimum).toBeNaN();
    expect([figures.values, figures.withoutValue]).toEqual([0, 1]);
  });
});
