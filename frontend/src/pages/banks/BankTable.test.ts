import { describe, expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import { changeOf } from "./BankTable";
import { TEXTS } from "./texts";

describe("changeOf", () => {
  it("describes changed, added and removed values", () => {
    expect(changeOf("0.342", "0.450")).toEqual({ text: "0.342 → 0.450", changed: true });
    expect(changeOf(undefined, "0.450")).toEqual({
      text: fillText(TEXTS.added, { value: "0.450" }),
      changed: true,
    });
    expect(changeOf("0.342", undefined)).toEqual({
      text: fillText(TEXTS.removed, { value: "0.342" }),
      changed: true,
    });
  });

  it("shows an unchanged value once", () => {
    expect(changeOf("0.342", "0.342")).toEqual({ text: "0.342", changed: false });
  });
});
