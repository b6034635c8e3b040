import { expect, it } from "vitest";
import { clockTime } from "../samples/format";
import { basisWords, grouped } from "./StatisticsTable";

const told = (time_s: number) => clockTime(time_s, 0.001);
const WHOLE = { of: "", range: { from_s: 0, to_s: 599.999 }, samples: 599_300, missing: 700, bucket_s: null };

it("says which samples figures come from, and how many are missing", () => {
  expect(basisWords([WHOLE], told)).toBe(
    "every sample between 0:00.000 and 9:59.999: 599\u202f300 samples, 700 missing",
  );
});

it("says so of each of several recordings, and of what has no sample", () => {
  const none = { ...WHOLE, of: "run 3", range: null, samples: 0 };
  const words = basisWords([{ ...WHOLE, of: "run 2", missing: 0 }, none], told);
  expect(words).toBe(
    "run 2: every sample between 0:00.000 and 9:59.999: 599\u202f300 samples; run 3: no sample in this range",
  );
  expect(basisWords([], told)).toBe("no sample in this range");
});

it("calls no envelope every sample", () => {
  const words = basisWords([{ ...WHOLE, bucket_s: 0.3, samples: 2000 }], told);
  expect(words).toBe("min and max per 0.300 s between 0:00.000 and 9:59.999: 2\u202f000 pairs");
});

it("groups digits in threes", () => {
  expect([0, 999, 1000, 1_234_567].map(grouped)).toEqual(["0", "999", "1\u202f000", "1\u202f234\u202f567"]);
});
