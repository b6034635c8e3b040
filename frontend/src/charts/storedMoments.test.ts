import { expect, it, vi } from "vitest";
import type { Moment, StoredData } from "./storedRuns";
import { StoredMoments } from "./storedRuns";

/** A recording in which q is ten times the time, that answers when it is told to. */
function recording() {
  const asked: { times: readonly number[]; signal: AbortSignal; answer(): void; refuse(): void }[] = [];
  const values: StoredData["values"] = (_names, times, signal) =>
    new Promise<Moment[]>((resolve, reject) => {
      const moments = times.map((time_s) => new Map([["q", 10 * time_s]]));
      asked.push({
        times,
        signal,
        answer: () => resolve(moments),
        refuse: () => reject(new Error("out of reach")),
      });
    });
  return { asked, moments: new StoredMoments({ values } as StoredData, ["q"]) };
}

it("asks once the moments have come to rest, and has their values then", async () => {
  const { asked, moments } = recording();
  moments.want([1, 2]);
  moments.want([1, 2.5]);
  expect(asked).toHaveLength(0);
  moments.want([1, 2.5]);
  moments.want([1, 2.5]);
  expect(asked.map(({ times }) => times)).toEqual([[1, 2.5]]);
  expect(moments.at("q", 1)).toBeNull();
  asked[0]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 2.5)).toBe(25));
  expect(moments.at("S", 1)).toBeNaN();
});

it("asks for what is new only, and leaves what nobody wants any more", async () => {
  const { asked, moments } = recording();
  for (const times of [[1], [1]]) moments.want(times);
  asked[0]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 1)).toBe(10));
  for (const times of [
    [1, 3],
    [1, 3],
    [1, 4],
    [1, 4],
  ])
    moments.want(times);
  expect(asked.map(({ times }) => times)).toEqual([[1], [3], [4]]);
  expect(asked[1]?.signal.aborted).toBe(true);
  asked[2]?.answer();
  await vi.waitFor(() => expect(moments.at("q", 4)).toBe(40));
  expect(moments.at("q", 1)).toBe(10);
});

it("says why there are none", async () => {
  const { asked, moments } = recording();
  for (const times of [[1], [1]]) moments.want(times);
  asked[0]?.refuse();
  await vi.waitFor(() => expect(moments.problem).toBe("out of reach"));
  expect(moments.at("q", 1)).toBeNull();
});
