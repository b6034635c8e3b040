import { expect, it } from "vitest";
import { ALARMS, CHOICES, kindsOf, NAMES } from "./LogRows";

it("offers refusals as a kind that is not an alarm", () => {
  expect(CHOICES).toContainEqual({ value: "refusal", label: "Refusals" });
  expect(kindsOf("refusal")).toEqual(["refusal"]);
  expect(kindsOf("alarms")).toBe(ALARMS);
  expect(ALARMS).not.toContain("refusal");
});

it("filters by one kind, by alarms or not at all", () => {
  expect(kindsOf("")).toEqual([]);
  expect(CHOICES.map(({ value }) => value)).toEqual(["", "alarms", ...Object.keys(NAMES)]);
});
