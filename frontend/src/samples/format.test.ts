import { describe, expect, it } from "vitest";
import {
  age,
  bytes,
  capital,
  clockTime,
  dateTime,
  dayTime,
  describeStructure,
  digitsApart,
  digitsOver,
  duration,
  fixed,
  heading,
  kilohertz,
  notANumber,
  numberIn,
  percent,
  short,
  significant,
  spacedName,
  timeOfDay,
  withError,
} from "./format";

describe("format", () => {
  describe("numbers", () => {
    it("have fixed decimals, a true minus sign and no negative zero", () => {
      expect(fixed(-1.234, 2)).toBe("−1.23");
      expect(fixed(-0.001, 2)).toBe("0.00");
      expect(fixed(12, 1)).toBe("12.0");
    });

    it("have a text if they are not finite, and null is a type error", () => {
      const numbers = [Number.NaN, Number.POSITIVE_INFINITY];
      expect(numbers.flatMap((number) => [fixed(number, 2), significant(number, 2)])).toEqual(
        Array(4).fill("no value"),
      );
      // @ts-expect-error an absent value goes through `ValueOrReason`, which requires the reason
      expect(fixed(null, 2)).toBe("no value");
      // @ts-expect-error the same
      expect(significant(undefined, 2)).toBe("no value");
    });

    it.each([
      [99.96, 1, "99.96"],
      [99.9996, 1, "99.9996"],
      [99.94, 1, "99.9"],
      [100, 1, "100.0"],
      [-3.2, 1, "−3.2"],
    ])("do not round a share below the whole to 100: %d", (value, decimals, text) => {
      expect(percent(value, decimals)).toBe(text);
    });

    it("preserve significant digits", () => {
      expect(significant(0.0499987, 4)).toBe("0.05000");
      expect(significant(-123.456, 4)).toBe("−123.5");
      expect(significant(4.919e-7, 3)).toBe("4.92·10⁻⁷");
      expect(significant(0, 3)).toBe("0");
    });

    it("have enough digits to differ", () => {
      const texts = (values: number[]) => values.map((value) => short(value, digitsApart(values)));
      expect(texts([10.0051, 10.0053, 10.01])).toEqual(["10.0051", "10.0053", "10.01"]);
      expect(texts([0.5, 0.8, 0.8])).toEqual(["0.5", "0.8", "0.8"]);
      expect(digitsApart([0.1 + 0.2, 0.3])).toBe(17);
      expect([digitsOver([10, 10.0093]), digitsOver([9, 12]), digitsOver([]), digitsOver([5, 5])]).toEqual([
        6, 4, 4, 4,
      ]);
    });
  });

  describe("times", () => {
    it("are formatted as an age", () => {
      expect([age(12.3), age(1400), age(125_000)]).toEqual(["12 ms", "1.4 s", "2 min"]);
    });

    it("are formatted as the duration of a run", () => {
      expect([duration(20.32), duration(59.96), duration(125), duration(3725)]).toEqual([
        "20.3 s",
        "60.0 s",
        "2:05 min",
        "1:02:05 h",
      ]);
    });

    it("label the time axis with the resolution of its steps", () => {
      expect(clockTime(75, 5)).toBe("1:15");
      expect(clockTime(75.25, 0.05)).toBe("1:15.25");
      expect(clockTime(59.9999, 0.5)).toBe("1:00.0");
      expect(clockTime(-2.5, 0.5)).toBe("−0:02.5");
      expect(clockTime(0.012, 0.002)).toBe("0:00.012");
    });

    it("show a date in the time zone of the page, and a text for an invalid one", () => {
      const local = new Date(2026, 0, 9, 7, 5, 3);
      expect(dateTime(local.toISOString())).toBe("2026-01-09 07:05:03");
      expect(dateTime("")).toBe("unknown time");
      expect(timeOfDay(local.toISOString(), new Date(2026, 0, 9, 23, 0))).toBe("07:05");
      expect(timeOfDay(local.toISOString(), new Date(2026, 0, 10, 1, 0))).toBe("2026-01-09 07:05");
      expect(timeOfDay("")).toBe("unknown time");
    });
  });

  it("formats the rate of the control loop in kHz", () => {
    expect(kilohertz(999.6)).toBe("1.000 kHz");
  });

  describe("bytes", () => {
    it("have decimal units", () => {
      expect([bytes(1_250_000), bytes(20_000_000_000), bytes(999_949_999), bytes(null)]).toEqual([
        "1.3 MB",
        "20.0 GB",
        "999.9 MB",
        "size unknown",
      ]);
    });
  });

  describe("the time of day", () => {
    it("is in the person's time zone, with the resolution of the step", () => {
      const epoch_s = new Date(2026, 2, 1, 14, 5, 9, 250).getTime() / 1000;
      expect(dayTime(epoch_s, 0.01)).toBe("14:05:09.25");
      expect(dayTime(epoch_s - 0.25, 5)).toBe("14:05:09");
      expect(dayTime(epoch_s + 0.7499, 0.1)).toBe("14:05:10.0");
      expect(dayTime(epoch_s, 0.001)).toBe("14:05:09.250");
    });
  });

  it.each([
    [333_412, 70_699, "(3.33 ± 0.71)·10⁵"],
    [-1577, 2179, "−1600 ± 2200"],
    [2.31847, 0.00312, "2.3185 ± 0.0031"],
    [0.342, 0.0996, "0.34 ± 0.10"],
    [350.2, 4.96, "350.2 ± 5.0"],
    [3.357e-6, 2.1e-8, "(3.357 ± 0.021)·10⁻⁶"],
    [0.05, 0.0001, "0.05000 ± 0.00010"],
    [7, Number.NaN, "7.000"],
    [7, 0, "7.000"],
  ])("rounds %d to the decimal place of its standard error %d", (value, error, text) => {
    expect(withError(value, error)).toBe(text);
  });
});

describe("words", () => {
  it.each([
    ["first", "First order"],
    ["third", "Third order"],
    ["lags4", "Four equal lags"],
    ["order:4", "Order 4, free poles"],
    ["lags2+delay", "Two equal lags, dead time"],
    ["order:1+delay", "Order 1, free poles, dead time"],
  ])("describes the structure %s as %s", (name, words) => {
    expect(describeStructure(name)).toBe(words);
  });

  it("formats a name of the service as words, with a capital in headings", () => {
    expect(spacedName("motor_identification")).toBe("motor identification");
    expect(heading("motor_identification")).toBe("Motor identification");
    expect(heading("tracking")).toBe("Tracking");
    expect(capital("smallest λ_q")).toBe("Smallest λ_q");
  });
});

describe("number", () => {
  it.each([
    ["5", 5],
    [" -53.5 ", -53.5],
    ["−12", -12],
    ["+.5", 0.5],
    ["1.", 1],
    ["1e1", 10],
    ["2.5E-1", 0.25],
    ["0,5", 0.5],
    ["−1,392", -1.392],
    [",5", 0.5],
  ])("parses %j as %d", (text, value) => {
    expect(numberIn(text)).toBe(value);
  });

  it.each([
    "",
    " ",
    "5-3",
    "1e",
    "1,2,3",
    "1,234.5",
    "1.234,5",
    "1 000",
    "0x10",
    "1e999",
    "Infinity",
    "NaN",
    "12deg",
    "--1",
    ".",
    ",",
  ])("does not parse %j as a number", (text) => {
    expect(numberIn(text)).toBeNull();
  });

  it("states the text that is not a number", () => {
    expect(notANumber(" 5-3 ")).toBe("“5-3” is not a number");
    expect(notANumber(" ")).toBe("a number is required");
  });
});
