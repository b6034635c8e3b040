import { describe, expect, it } from "vitest";
import {
  type AngleUnit,
  angleText,
  boxText,
  formatWithUnit,
  inSI,
  localizeText,
  offeredDefault,
  rangeText,
  readingNear,
  readingOf,
} from "./quantity";

/** Angles in degrees with up to six decimals, the same in each run. */
function* someAngles(): Generator<number> {
  let state = 12345;
  for (let count = 0; count < 5000; count += 1) {
    state = (1103515245 * state + 12345) % 2 ** 31;
    yield Number(((state / 2 ** 31 - 0.5) * 720).toFixed(count % 7));
  }
}

const MARK = "\u202f";

describe("a box", () => {
  it("shows 1.0471975511965976 rad as 60 and sends the same value", () => {
    expect(boxText(1.0471975511965976, "rad", "deg")).toBe("60");
    expect(inSI("60", "rad", "deg")).toBe(1.0471975511965976);
    expect(boxText(1.0471975511965976, "rad", "rad")).toBe("1.0472");
  });

  it("shows every angle as it was typed", () => {
    for (const typed of someAngles()) {
      const text = String(typed);
      const sent = inSI(text, "rad", "deg") as number;
      // One turn is 2π: the same ratio, computed differently.
      expect(sent / (2 * Math.PI)).toBeCloseTo(typed / 360, 14);
      if (text.length <= 9) expect(boxText(sent, "rad", "deg")).toBe(text);
      else expect(Number(boxText(sent, "rad", "deg"))).toBeCloseTo(typed, 2);
    }
  });

  it("limits the number of digits in every unit", () => {
    for (const angle of someAngles()) {
      for (const angles of ["deg", "rad"] satisfies AngleUnit[]) {
        const text = boxText(Math.sin(angle) * 100, "rad", angles);
        expect(text.replace(/e.*|\D/g, "").replace(/^0+/, "").length, text).toBeLessThanOrEqual(8);
      }
    }
  });

  it("does not convert other quantities than angles", () => {
    expect(inSI("12.5", "N·m/rad", "deg")).toBe(12.5);
    expect(boxText(12.5, "N·m/rad", "deg")).toBe("12.5");
    expect(boxText(80, "", "deg")).toBe("80");
    expect(inSI("five", "rad", "deg")).toBeNull();
  });
});

it.each([
  ["rad", "°", 57.29577951308232],
  ["rad/s", "°/s", 57.29577951308232],
  ["mrad", "°", 0.05729577951308232],
  ["rad·s", "°·s", 57.29577951308232],
  ["N·m/rad", "N·m/rad", 1],
  ["rad/(V·s)", "rad/(V·s)", 1],
  ["1", "1", 1],
])("converts %s to %s by its unit", (unit, shown, factor) => {
  expect(readingOf(unit, "deg").unit).toBe(shown);
  expect(readingOf(unit, "deg").factor).toBeCloseTo(factor, 14);
  expect(readingOf(unit, "rad")).toEqual({ unit, factor: 1 });
});

it.each([
  [0.01, 2, "rad", "0.573 to 114"],
  [-1.4, 1.4, "rad", "−80.2 to 80.2"],
  [(0.5 * Math.PI) / 180, (114.25 * Math.PI) / 180, "rad", "0.5 to 114"],
  [0.354416386, 3, "s", "0.355 to 3"],
  [4.9981, 5.0023, "V", "4.999 to 5.002"],
  [0, 2147483647, "1", "0 to 2147483647"],
  [9999.6321, 123456.7, "1", "10000 to 123000"],
])("shows %d to %d %s as a range whose bounds are accepted", (low, high, unit, range) => {
  expect(rangeText(low, high, unit, "deg")).toBe(range);
  const ends = range.split(" to ").map((end) => inSI(end.replace("−", "-"), unit, "deg") as number);
  expect(Math.min(...ends)).toBeGreaterThanOrEqual(low - 1e-12 * Math.abs(low));
  expect(Math.max(...ends)).toBeLessThanOrEqual(high * (1 + 1e-12));
});

it.each([
  [1, "rad", 57.3],
  [12, "rad", 688],
  [Math.PI / 3, "rad", 60],
  [0.004, "s", 0.004],
])("rounds a default of %d %s to few digits, and sends the shown value", (usual, unit, shown) => {
  const inForm = offeredDefault(usual, { unit }, "deg") as number;
  expect(boxText(inForm, unit, "deg")).toBe(String(shown));
  expect(inSI(String(shown), unit, "deg")).toBe(inForm);
  expect(offeredDefault(usual, { unit }, "rad")).toBe(usual);
});

it("does not round a default that rounding would move out of its range", () => {
  expect(offeredDefault(1, { unit: "rad", maximum: 1 }, "deg")).toBe(1);
  expect(offeredDefault("geometry", { unit: "" }, "deg")).toBe("geometry");
});

it("writes exponents as powers of ten", () => {
  expect(formatWithUnit(3.357e-6, "V", "deg")).toBe("3.357 µV");
  expect(formatWithUnit(3.357e-9, "N·m/rad", "deg")).toBe("3.357·10⁻⁹ N·m/rad");
  expect(localizeText(`7.019e-05${MARK}N at 3e-06${MARK}V, 2e-09${MARK}N·m/rad`, "deg")).toBe(
    "70.19 µN at 3 µV, 2e-09 N·m/rad",
  );
  expect(inSI(boxText(3.3e-7, "V", "deg"), "V", "deg")).toBe(3.3e-7);
  expect(boxText(3.3e-7, "V", "deg")).toBe("0.00000033");
});

it("formats a quantity with its unit", () => {
  expect(formatWithUnit(2.0943951023931953, "rad", "deg")).toBe("120°");
  expect(formatWithUnit(-2.0943951023931953, "rad", "rad")).toBe("−2.0944 rad");
  expect(formatWithUnit(0.5, "1", "deg")).toBe("0.5");
  expect(angleText(Math.PI / 6, 1, "deg")).toBe("30.0");
  expect(angleText(Math.PI / 6, 1, "rad")).toBe("0.524");
});

it.each([
  ["q = 1.602~rad; the bound is 1.571~rad to either side", "q = 91.79°; the bound is 90.01° to either side"],
  ["outside -1.4 to 1.4~rad; choose another", "outside -80.21 to 80.21°; choose another"],
  ["q_ref 0.5236~rad, S_ref 10.00~N·m/rad", "q_ref 30°, S_ref 10.00 N·m/rad"],
  ["turned by −0.9~rad", "turned by −51.57°"],
  ["60~rad/s, K_m 1.06~rad/(V·s), 2~N·m/rad per rad", "3438°/s, K_m 1.06 rad/(V·s), 2 N·m/rad per rad"],
  ["2~rad² for 8~N and 2 to 3~V", "2 rad² for 8 N and 2 to 3 V"],
])("converts only the marked angles in %j", (text, degrees) => {
  expect(localizeText(text.replaceAll("~", MARK), "deg")).toBe(degrees);
  expect(localizeText(text.replaceAll("~", MARK), "rad")).toBe(text.replaceAll("~", " "));
});

it("does not change a person's text, even if it contains the mark of a quantity", () => {
  for (const angles of ["deg", "rad"] as const) {
    expect(localizeText("keep it below 1 rad, 30 deg or 3e-6 V", angles)).toBe(
      "keep it below 1 rad, 30 deg or 3e-6 V",
    );
    expect(localizeText(`“1${MARK}\u2060rad ${MARK}\u2060\u2060”`, angles)).toBe(
      `“1${MARK}rad ${MARK}\u2060”`,
    );
  }
});

it("converts a text in degrees to radians when a person changes the unit", () => {
  for (const unit of ["deg", "°"].map((one) => MARK + one)) {
    const text = `120${unit} is outside -100 to 100${unit}; phase margin 47°`;
    expect(localizeText(text, "rad")).toBe("2.094 rad is outside -1.745 to 1.745 rad; phase margin 47°");
    expect(localizeText(text, "deg")).toBe("120° is outside -100 to 100°; phase margin 47°");
  }
});

it.each([
  [7.019e-5, "V", "µV", 70.19],
  [3.357e-6, "V", "µV", 3.357],
  [-4.2e-8, "N", "nN", -42],
  [0.0021, "V", "V", 0.0021],
  [0, "V", "V", 0],
  [1e-5, "1", "1", 1e-5],
  [1e-5, "N·m/rad", "N·m/rad", 1e-5],
])("formats %d %s in %s", (value, unit, read, figure) => {
  const reading = readingNear(value, unit, "deg");
  expect(reading.unit).toBe(read);
  expect(value * reading.factor).toBeCloseTo(figure, 9);
});
