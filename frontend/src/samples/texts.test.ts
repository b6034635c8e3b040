import { expect, it } from "vitest";
import { countThings, fillText } from "./texts";

it("fills each field once, and does not change a person's text in it", () => {
  expect(fillText("Run {run} of {name}: {run}", { run: 12, name: "{run} by Ana" })).toBe(
    "Run 12 of {run} by Ana: 12",
  );
  expect(fillText("No field", {})).toBe("No field");
});

it("requires the fields of the text", () => {
  // @ts-expect-error: the compiler refuses a missing field
  expect(fillText("Run {run}", {})).toBe("Run undefined");
});

it("adds the noun in singular or plural", () => {
  expect([0, 1, 2].map((count) => countThings(count, "entry", "entries"))).toEqual([
    "0 entries",
    "1 entry",
    "2 entries",
  ]);
  expect([1, 0.5].map((count) => countThings(count, "day"))).toEqual(["1 day", "0.5 days"]);
});
