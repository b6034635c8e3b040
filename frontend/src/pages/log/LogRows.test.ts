import { expect, it } from "vitest";
import { ALARMS, CHOICES, kindsOf, NAMES } from "./LogRows";

it("offers refusals by themselves, and they are no alarms", () => {
  expect(CHOICES).toContainEqual({ value: "refusal", label: "Refusals" });
  expect(kindsOf("refusal")).toEqual(["refusal"]);
  expect(kindsOf("alarms")).toBe(ALARMS);
  expect(ALARMS).not.toContain("refusal");
});

it("narrows to nothing but what it names", () => {
  expect(kindsOf("")).toEqual([]);
  expect(CHOICES.map(({ value }) => value)).toEqual(["", "alarms", ...Object.keys(NAMES)]);
});
