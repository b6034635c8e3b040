import { expect, it } from "vitest";
import { notANumber, numberIn } from "./number";

it.each([
  ["5", 5],
  [" -53.5 ", -53.5],
  ["−12", -12],
  ["+.5", 0.5],
  ["1.", 1],
  ["1e1", 10],
  ["2.5E-1", 0.25],
  ["0,5", 0.5],
  ["−1,392", -1.392],
  [",5", 0.5],
])("reads %j as %d", (text, value) => {
  expect(numberIn(text)).toBe(value);
});

it.each([
  "",
  " ",
  "5-3",
  "1e",
  "1,2,3",
  "1,234.5",
  "1.234,5",
  "1 000",
  "0x10",
  "1e999",
  "Infinity",
  "NaN",
  "12deg",
  "--1",
  ".",
  ",",
])("does not take %j for a number", (text) => {
  expect(numberIn(text)).toBeNull();
});

it("says what was not taken", () => {
  expect(notANumber(" 5-3 ")).toBe("“5-3” is not a number");
  expect(notANumber(" ")).toBe("needs a number");
});
