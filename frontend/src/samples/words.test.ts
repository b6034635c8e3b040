import { expect, it } from "vitest";
import { capital, counted, heading, inWordsOf, structureInWords } from "./words";

it.each([
  ["first", "First order"],
  ["third", "Third order"],
  ["lags4", "Four equal lags"],
  ["order:4", "Order 4, free poles"],
  ["lags2+delay", "Two equal lags, dead time"],
  ["order:1+delay", "Order 1, free poles, dead time"],
])("reads the structure %s as %s", (name, words) => {
  expect(structureInWords(name)).toBe(words);
});

it("says one day and many days", () => {
  expect([1, 0, 2, 0.5].map((days) => counted(days, "day"))).toEqual([
    "1 day",
    "0 days",
    "2 days",
    "0.5 days",
  ]);
});

it("reads a name of the service as words, with a capital where it stands alone", () => {
  expect(inWordsOf("motor_identification")).toBe("motor identification");
  expect(heading("motor_identification")).toBe("Motor identification");
  expect(heading("tracking")).toBe("Tracking");
  expect(capital("smallest λ_q")).toBe("Smallest λ_q");
});
