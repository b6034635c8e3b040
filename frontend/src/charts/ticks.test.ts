import { describe, expect, it } from "vitest";
import { clockTime } from "../samples/format";
import { logLabels, tickLabels } from "./plot";

/** What somebody reads off a label. */
function read(label: string): number {
  return Number(label.replaceAll("−", "-"));
}

/** Distances that uPlot chooses from: 1, 2, 2.5 and 5 times a power of ten. */
const STEPS = [-9, -6, -4, -3, -2, -1, 0, 1, 2, 5, 8].flatMap((power) =>
  [1, 2, 2.5, 5].map((digit) => Number(`${digit}e${power}`)),
);

describe("labels of an axis", () => {
  it("say where the grid line is, at every distance of the lines", () => {
    for (const step of STEPS) {
      for (const first of [-12, -3, 0, 1, 39]) {
        const splits = [0, 1, 2, 3, 4].map((index) => (first + index) * step);
        const labels = tickLabels(splits, step);
        for (const [index, label] of labels.entries())
          expect(Math.abs(read(label) - (splits[index] as number)), `${label} by ${step}`).toBeLessThan(
            1e-6 * step,
          );
        expect(new Set(labels).size).toBe(5);
      }
    }
  });

  it("have as many decimals as their neighbours, and no more than they need", () => {
    expect(tickLabels([6.25, 6.5, 6.75, 7, 7.25, 7.5], 0.25)).toEqual([
      "6.25",
      "6.50",
      "6.75",
      "7.00",
      "7.25",
      "7.50",
    ]);
    expect(tickLabels([-10, -7.5, -5, -2.5, 0], 2.5)).toEqual(["−10.0", "−7.5", "−5.0", "−2.5", "0.0"]);
    expect(tickLabels([8, 10], 2)).toEqual(["8", "10"]);
  });

  it("stay short where the numbers are very small or very large", () => {
    expect(tickLabels([2.5e-7, 5e-7], 2.5e-7)).toEqual(["2.5e−7", "5.0e−7"]);
    expect(tickLabels([1.25e8, 1.5e8], 2.5e7)).toEqual(["1.25e8", "1.50e8"]);
  });

  it("of a logarithmic axis say where the line is, and leave out what the chart leaves out", () => {
    expect(logLabels([0.001, null, 0.1, 0.2, 1, 10, 1000, 1e5, 2e-6])).toEqual([
      "0.001",
      "",
      "0.1",
      "0.2",
      "1",
      "10",
      "1000",
      "1e5",
      "2e−6",
    ]);
    for (const power of [-12, -5, -4, -3, -1, 0, 3, 4, 9])
      for (const digit of [1, 2, 3, 5, 7]) {
        const value = digit * 10 ** power;
        expect(read(logLabels([value])[0] as string) / value).toBeCloseTo(1, 9);
      }
  });
});

it("writes instants as finely as the lines are apart", () => {
  for (const step of [0.001, 0.0025, 0.025, 0.05, 0.25, 0.5, 2.5, 15]) {
    for (const count of [1, 2, 3, 5, 41]) {
      const [minutes, seconds] = clockTime(count * step, step)
        .split(":")
        .map(read) as [number, number];
      expect(60 * minutes + seconds).toBeCloseTo(count * step, 6);
    }
  }
});
