import { describe, expect, it } from "vitest";
import {
  type Angles,
  angleText,
  boxText,
  inSI,
  inWords,
  rangeText,
  readingNear,
  readingOf,
  told,
} from "./quantity";

/** Angles in degrees with up to six decimals, the same at each run. */
function* someAngles(): Generator<number> {
  let state = 12345;
  for (let count = 0; count < 5000; count += 1) {
    state = (1103515245 * state + 12345) % 2 ** 31;
    yield Number(((state / 2 ** 31 - 0.5) * 720).toFixed(count % 7));
  }
}

describe("a box", () => {
  it("shows 1.0471975511965976 rad as 60 and sends it again", () => {
    expect(boxText(1.0471975511965976, "rad", "deg")).toBe("60");
    expect(inSI("60", "rad", "deg")).toBe(1.0471975511965976);
    expect(boxText(1.0471975511965976, "rad", "rad")).toBe("1.0472");
  });

  it("shows every angle again as it was typed", () => {
    for (const typed of someAngles()) {
      const text = String(typed);
      const sent = inSI(text, "rad", "deg") as number;
      // a turn of the circle is 2π: the same ratio, worked out another way
      expect(sent / (2 * Math.PI)).toBeCloseTo(typed / 360, 14);
      if (text.length <= 9) expect(boxText(sent, "rad", "deg")).toBe(text);
      else expect(Number(boxText(sent, "rad", "deg"))).toBeCloseTo(typed, 2);
    }
  });

  it("never shows more digits than a person reads, whatever the unit", () => {
    for (const angle of someAngles()) {
      for (const angles of ["deg", "rad"] satisfies Angles[]) {
        const text = boxText(Math.sin(angle) * 100, "rad", angles);
        expect(text.replace(/e.*|\D/g, "").replace(/^0+/, "").length, text).toBeLessThanOrEqual(8);
      }
    }
  });

  it("takes what is no angle as it is", () => {
    expect(inSI("12.5", "N·m/rad", "deg")).toBe(12.5);
    expect(boxText(12.5, "N·m/rad", "deg")).toBe("12.5");
    expect(boxText(80, "", "deg")).toBe("80");
    expect(inSI("five", "rad", "deg")).toBeNull();
  });
});

it.each([
  ["rad", "deg", 57.29577951308232],
  ["rad/s", "deg/s", 57.29577951308232],
  ["mrad", "deg", 0.05729577951308232],
  ["rad·s", "deg·s", 57.29577951308232],
  ["N·m/rad", "N·m/rad", 1],
  ["rad/(V·s)", "rad/(V·s)", 1],
  ["1", "1", 1],
])("reads %s in %s, by its unit alone", (unit, shown, factor) => {
  expect(readingOf(unit, "deg").unit).toBe(shown);
  expect(readingOf(unit, "deg").factor).toBeCloseTo(factor, 14);
  expect(readingOf(unit, "rad")).toEqual({ unit, factor: 1 });
});

it.each([
  [0.01, 2, "rad", "0.573 … 114.5"],
  [-1.4, 1.4, "rad", "−80.21 … 80.21"],
  [(0.5 * Math.PI) / 180, (114.25 * Math.PI) / 180, "rad", "0.5 … 114.25"],
  [0.354416386, 3, "s", "0.3545 … 3"],
  [0, 2147483647, "1", "0 … 2147483647"],
  [9999.6321, 123456.7, "1", "10000 … 123400"],
])("offers %d to %d %s as a range of which every end is accepted", (low, high, unit, range) => {
  expect(rangeText(low, high, unit, "deg")).toBe(range);
  const ends = range.split(" … ").map((end) => inSI(end.replace("−", "-"), unit, "deg") as number);
  expect(Math.min(...ends)).toBeGreaterThanOrEqual(low - 1e-12 * Math.abs(low));
  expect(Math.max(...ends)).toBeLessThanOrEqual(high * (1 + 1e-12));
});

it("tells a quantity with its unit", () => {
  expect(told(2.0943951023931953, "rad", "deg")).toBe("120 deg");
  expect(told(-2.0943951023931953, "rad", "rad")).toBe("−2.0944 rad");
  expect(told(0.5, "1", "deg")).toBe("0.5");
  expect(angleText(Math.PI / 6, 1, "deg")).toBe("30.0");
  expect(angleText(Math.PI / 6, 1, "rad")).toBe("0.524");
});

it.each([
  [
    "q = 1.602 rad; the bound is 1.571 rad to either side",
    "q = 91.79 deg; the bound is 90.01 deg to either side",
  ],
  ["outside -1.4 to 1.4 rad; choose another", "outside -80.21 to 80.21 deg; choose another"],
  ["q_ref 0.5236 rad, S_ref 10.00 N·m/rad", "q_ref 30 deg, S_ref 10.00 N·m/rad"],
  ["turned by −0.9 rad", "turned by −51.57 deg"],
  ["60 rad/s, K_m 1.06 rad/(V·s), 2 N·m/rad per rad", "3438 deg/s, K_m 1.06 rad/(V·s), 2 N·m/rad per rad"],
  ["3 radishes, 2 rad²", "3 radishes, 2 rad²"],
])("reads the angles in %j and nothing else", (text, degrees) => {
  expect(inWords(text, "deg")).toBe(degrees);
  expect(inWords(text, "rad")).toBe(text);
});

it("reads a text in degrees in radians, where somebody changes the unit while it stands", () => {
  expect(inWords("120 deg is outside -100 to 100 deg", "rad")).toBe(
    "2.094 rad is outside -1.745 to 1.745 rad",
  );
});

it.each([
  [7.019e-5, "V", "µV", 70.19],
  [3.357e-6, "V", "µV", 3.357],
  [-4.2e-8, "N", "nN", -42],
  [0.0021, "V", "V", 0.0021],
  [0, "V", "V", 0],
  [1e-5, "1", "1", 1e-5],
  [1e-5, "N·m/rad", "N·m/rad", 1e-5],
])("reads %d %s in %s", (value, unit, read, figure) => {
  const reading = readingNear(value, unit, "deg");
  expect(reading.unit).toBe(read);
  expect(value * reading.factor).toBeCloseTo(figure, 9);
});
