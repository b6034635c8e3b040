import { expect, test } from "vitest";
import { cellsOf, colourOf, colourRange, inkOf, ticksOf } from "./MapsCard";

test("the smallest value is darkest, the largest lightest, and the first row is at the bottom", () => {
  const { range, drawn } = cellsOf(
    [
      [1, 2],
      [3, null],
    ],
    200,
    100,
  );
  expect(range).toEqual([1, 3]);
  expect(drawn.map(({ colour }) => colour)).toEqual([colourOf(0), colourOf(0.5), colourOf(1), null]);
  expect(drawn.map(({ left, top }) => [left, top])).toEqual([
    [0, 50],
    [100, 50],
    [0, 0],
    [100, 0],
  ]);
  expect(drawn.map(({ text }) => text)).toEqual(["1", "2", "3", ""]);
});

test("a map with one value has a colour, and one without values has none", () => {
  expect(cellsOf([[4, 4]], 100, 100).drawn[0]?.colour).toBe(colourOf(0.5));
  expect(cellsOf([[null]], 100, 100).drawn[0]?.colour).toBeNull();
  expect(cellsOf([[null]], 100, 100).range).toBeNull();
});

test("values that differ by less than 5 % do not use the whole colour range", () => {
  const [low, high] = colourRange([8.847, 8.856]);
  expect(high - low).toBeCloseTo(0.05 * 8.856, 9);
  expect((low + high) / 2).toBeCloseTo(8.8515, 9);
  expect(colourRange([8, 9])).toEqual([8, 9]);
  expect(colourRange([-0.01, 0.02])).toEqual([-0.01, 0.02]);
  expect(colourRange([0, 0])).toEqual([-0.5, 0.5]);
});

test("numbers have a contrast of at least 4.5 to the colour of their cell", () => {
  for (let share = 0; share <= 1; share += 0.01) {
    const parts = (colourOf(share).match(/\d+/g) ?? []).map((part) => {
      const value = Number(part) / 255;
      return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    });
    const ground = 0.2126 * (parts[0] ?? 0) + 0.7152 * (parts[1] ?? 0) + 0.0722 * (parts[2] ?? 0);
    const text = inkOf(share) === "#ffffff" ? 1 : 0;
    expect((Math.max(ground, text) + 0.05) / (Math.min(ground, text) + 0.05)).toBeGreaterThanOrEqual(4.5);
  }
});

test("shares outside 0 to 1 have the colours at the ends of the scale", () => {
  expect(colourOf(-1)).toBe("rgb(68 1 84)");
  expect(colourOf(2)).toBe("rgb(253 231 37)");
});

test("an axis labels every value, or equally spaced ones if there are many", () => {
  expect(ticksOf(3)).toEqual([0, 1, 2]);
  expect(ticksOf(20)).toEqual([0, 3, 6, 9, 12, 15, 18]);
});
