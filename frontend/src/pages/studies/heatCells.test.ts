import { expect, test } from "vitest";
import { cellsOf, colourOf, ticksOf } from "./heatCells";

test("the least number is darkest, the largest lightest, and rows begin at the bottom", () => {
  const { least, largest, drawn } = cellsOf(
    [
      [1, 2],
      [3, null],
    ],
    200,
    100,
  );
  expect([least, largest]).toEqual([1, 3]);
  expect(drawn.map(({ colour }) => colour)).toEqual([colourOf(0), colourOf(0.5), colourOf(1), null]);
  expect(drawn.map(({ left, top }) => [left, top])).toEqual([
    [0, 50],
    [100, 50],
    [0, 0],
    [100, 0],
  ]);
  expect(drawn.map(({ text }) => text)).toEqual(["1", "2", "3", ""]);
});

test("a map of one number has a colour, and one of none has none", () => {
  expect(cellsOf([[4, 4]], 100, 100).drawn[0]?.colour).toBe(colourOf(0.5));
  expect(cellsOf([[null]], 100, 100).drawn[0]?.colour).toBeNull();
});

test("the ends of the colours are those of the scale", () => {
  expect(colourOf(-1)).toBe("rgb(68 1 84)");
  expect(colourOf(2)).toBe("rgb(253 231 37)");
});

test("few values are all written, many by equal steps", () => {
  expect(ticksOf(3)).toEqual([0, 1, 2]);
  expect(ticksOf(20)).toEqual([0, 3, 6, 9, 12, 15, 18]);
});
