import { expect, it } from "vitest";
import { RequestError } from "../wire/client";
import type { State } from "../wire/types";
import { isAboutControl, whyNoControl } from "./control";

const HOLDER = { name: "Mara Stein", epoch: 7, page: true, lost: false } as NonNullable<State["holder"]>;

it("says who holds control, and nothing where this page commands or may take control", () => {
  expect(whyNoControl(HOLDER, null)).toBe("Mara Stein holds control.");
  expect(whyNoControl({ ...HOLDER, page: false }, null)).toBe("Mara Stein holds control by a script.");
  expect(whyNoControl(HOLDER, 6)).toBe("Mara Stein holds control.");
  expect(whyNoControl(HOLDER, 7)).toBeNull();
  expect(whyNoControl(HOLDER, 8)).toBeNull(); // taken already, and the state is of before
  expect(whyNoControl({ ...HOLDER, lost: true }, null)).toBeNull();
  expect(whyNoControl(null, 7)).toBeNull();
});

it("offers control for refusals about control only", () => {
  const refused = (code: string) =>
    new RequestError("no", 409, { code, message: "no" } as RequestError["problem"]);
  for (const code of ["control_held", "control_lost", "control_needed"])
    expect(isAboutControl(refused(code))).toBe(true);
  expect(isAboutControl(refused("not_in_this_mode"))).toBe(false);
  expect(isAboutControl(new Error("no"))).toBe(false);
  expect(isAboutControl(null)).toBe(false);
});
