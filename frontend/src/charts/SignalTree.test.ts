import { expect, it } from "vitest";
import { found, signalChoices } from "./SignalTree";

const names = (words: string) =>
  found(signalChoices(null), words).flatMap(({ items }) => items.map(({ value }) => value));

it("finds signals by name, meaning and unit that contain all words", () => {
  expect(names("")).toContain("q");
  expect(names("f_a")).toContain("F_A");
  expect(names("f_a")).not.toContain("u_A");
  const forces = found(signalChoices(null), "tendon force");
  expect(forces.map(({ group }) => group)).toEqual(["N"]);
  expect(names("tendon V")).not.toContain("F_A");
  expect(names("nothing like it")).toEqual([]);
});
