// @vitest-environment jsdom

import { afterEach, expect, it, vi } from "vitest";
import {
  claimDraft,
  type DraftKey,
  isStored,
  parseDraft,
  renameDrafts,
  storeDraft,
  storedDraft,
  watchDrafts,
} from "./draftStorage";

const KEY: DraftKey = { person: "Mara Stein", form: "study" };
const other = (part: Partial<DraftKey>): DraftKey => ({ ...KEY, ...part });

afterEach(() => {
  vi.restoreAllMocks();
  vi.useRealTimers();
  storeDraft(KEY, null);
  localStorage.clear();
});

const read = (key: DraftKey) => parseDraft(storedDraft(key))?.value;

it("stores the drafts of each person and each form separately", () => {
  storeDraft(KEY, { text: "a" });
  storeDraft(other({ person: "Vera" }), { text: "b" });
  storeDraft(other({ form: "experiment" }), { text: "c" });
  expect(read(KEY)).toEqual({ text: "a" });
  storeDraft(KEY, null);
  expect(read(KEY)).toBeUndefined();
  expect(read(other({ person: "Vera" }))).toEqual({ text: "b" });
  expect(localStorage).toHaveLength(2);
});

it("keeps the time of the first change", () => {
  vi.useFakeTimers({ now: new Date("2031-05-01T08:00:00Z") });
  storeDraft(KEY, "a");
  vi.setSystemTime(new Date("2031-05-01T09:00:00Z"));
  storeDraft(KEY, "ab");
  expect(parseDraft(storedDraft(KEY))).toEqual({ value: "ab", since: "2031-05-01T08:00:00.000Z" });
  storeDraft(KEY, null);
  storeDraft(KEY, "c");
  expect(parseDraft(storedDraft(KEY))?.since).toBe("2031-05-01T09:00:00.000Z");
});

it.each([
  "",
  "no JSON",
  "null",
  '{"format":2,"since":"2031-05-01T08:00:00Z","value":1}',
  '{"format":1,"since":"yesterday","value":1}',
])("rejects a text that is no draft of this version: %s", (text) => {
  storeDraft(KEY, "a");
  localStorage.setItem(localStorage.key(0) ?? "", text);
  expect(parseDraft(storedDraft(KEY))).toBeNull();
});

it("holds a draft in memory if the browser stores nothing, and reports this", () => {
  const refused = vi.spyOn(Storage.prototype, "setItem").mockImplementation(() => {
    throw new DOMException("The quota has been exceeded.", "QuotaExceededError");
  });
  storeDraft(KEY, "a");
  expect(read(KEY)).toBe("a");
  expect(isStored(KEY)).toBe(false);
  expect(localStorage).toHaveLength(0);
  refused.mockRestore();
  storeDraft(KEY, "ab"); // stored again as soon as the browser permits it
  expect(isStored(KEY)).toBe(true);
  expect(localStorage).toHaveLength(1);
});

it("prefers a newer draft in memory to the stored one", () => {
  storeDraft(KEY, "old");
  vi.spyOn(Storage.prototype, "setItem").mockImplementation(() => {
    throw new DOMException("The quota has been exceeded.", "QuotaExceededError");
  });
  storeDraft(KEY, "new");
  expect(read(KEY)).toBe("new");
});

it("claims a draft for the person that was typed before the person was known", () => {
  const unknown = other({ person: undefined });
  storeDraft(unknown, "a");
  expect(read(unknown)).toBe("a");
  expect(localStorage).toHaveLength(0);
  expect(read(KEY)).toBe("a");
  claimDraft(KEY);
  expect(localStorage).toHaveLength(1);
  expect(read(unknown)).toBeUndefined();
  expect(read(other({ person: "Vera" }))).toBeUndefined();
  storeDraft(unknown, "b");
  claimDraft(KEY);
  expect(read(KEY)).toBe("a"); // the person's own draft remains
});

it("moves drafts to the new name of a person, with their time, and replaces none", () => {
  storeDraft(KEY, "a");
  const since = parseDraft(storedDraft(KEY))?.since;
  storeDraft(other({ form: "experiment" }), "b");
  storeDraft(other({ person: "Vera", form: "experiment" }), "c");
  renameDrafts("Mara Stein", "Vera");
  expect(parseDraft(storedDraft(other({ person: "Vera" })))).toEqual({ value: "a", since });
  expect(read(other({ person: "Vera", form: "experiment" }))).toBe("c");
  expect(read(other({ person: "Vera (2)" }))).toBe("a"); // the same name on another page
});

it("reports changes of this page and of another tab until it is stopped", () => {
  const onChange = vi.fn();
  const stop = watchDrafts(onChange);
  storeDraft(KEY, "a");
  expect(onChange).toHaveBeenCalledTimes(1);
  window.dispatchEvent(new StorageEvent("storage"));
  expect(onChange).toHaveBeenCalledTimes(2);
  stop();
  storeDraft(KEY, "b");
  window.dispatchEvent(new StorageEvent("storage"));
  expect(onChange).toHaveBeenCalledTimes(2);
});
