import { describe, expect, it } from "vitest";
import { fillText } from "../../samples/texts";
import type { IdentificationKind } from "../../wire/types";
import { originOf, requestOf, valuesOf } from "./IdentificationForm";
import { SETTING_LABELS, TEXTS } from "./texts";

const ACTUATOR: IdentificationKind = {
  kind: "actuator",
  title: "Actuator",
  description: "",
  settings: [
    { name: "tension_N", symbol: "", meaning: "tension", unit: "N", default: 20 },
    { name: "chip_s", symbol: "", meaning: "chip", unit: "s", default: 0.04 },
  ],
};

describe("requestOf", () => {
  it("requests all shown settings", () => {
    const values = valuesOf(ACTUATOR, { tension_N: 30 }, "deg");
    expect(values).toEqual({ tension_N: 30, chip_s: 0.04 });
    expect(requestOf(ACTUATOR, values, "")).toEqual({
      request: { kind: "actuator", ...values },
      problem: null,
    });
    expect(ACTUATOR.settings.map((setting) => originOf(setting, { tension_N: 30 }, "deg"))).toEqual([
      fillText(TEXTS.defaultIs, { value: "20" }),
      TEXTS.usesDefault,
    ]);
  });

  it("sends a chosen option, or the default", () => {
    const estimator = {
      name: "estimator",
      symbol: "",
      meaning: "estimator",
      unit: "1",
      default: "default",
      choices: ["default", "arx"],
    };
    const kind = { ...ACTUATOR, settings: [...ACTUATOR.settings, estimator] };
    expect(requestOf(kind, valuesOf(kind, {}, "deg"), "").request).toMatchObject({ estimator: "default" });
    const arx = { estimator: "arx" };
    expect(requestOf(kind, valuesOf(kind, arx, "deg"), "").request).toMatchObject(arx);
    expect([originOf(estimator, {}, "deg"), originOf(estimator, arx, "deg")]).toEqual([
      TEXTS.usesDefault,
      fillText(TEXTS.defaultIs, { value: "default" }),
    ]);
  });

  it("omits the single tension while a list is given", () => {
    expect(requestOf(ACTUATOR, valuesOf(ACTUATOR, { tension_N: "" }, "deg"), "10 20").request).toEqual({
      kind: "actuator",
      chip_s: 0.04,
      tensions_N: [10, 20],
    });
  });

  it("reads several tensions from a list", () => {
    expect(requestOf(ACTUATOR, {}, " 10, 20;30 40 ").request).toEqual({
      kind: "actuator",
      tensions_N: [10, 20, 30, 40],
    });
  });

  it("reports a value that is not a number, without a request", () => {
    expect(requestOf(ACTUATOR, { chip_s: "" }, "")).toMatchObject({
      request: null,
      problem: fillText(TEXTS.notANumber, {
        label: SETTING_LABELS.chip_s ?? "",
        problem: "a number is required",
      }),
      place: "chip_s",
    });
    for (const text of ["10, twenty", "0x10", "1e"]) {
      expect(requestOf(ACTUATOR, {}, text)).toMatchObject({ request: null });
    }
    expect(requestOf(ACTUATOR, {}, "8 9 10 11 12 13 14 15 16").problem).toBe(
      fillText(TEXTS.tooManyTensions, { most: 8 }),
    );
  });
});
