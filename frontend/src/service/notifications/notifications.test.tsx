import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { clicked, look, shown, tones, useBrowser } from "./browser.fixture";
import { announceVisibility, type PageNotification, showNotification } from "./notifications";

const BOTH = { notification: true, sound: true };

function told(tag = "sinew-run-3", open = () => undefined): PageNotification {
  return { tag, title: "Tracking, run 3: completed", body: "Steps", open };
}

beforeEach(() => {
  vi.useFakeTimers();
  look(false);
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

it("tells whoever does not look, with the words and the tag, and leads to the place on a click", async () => {
  useBrowser("granted");
  const focused = vi.spyOn(window, "focus").mockReturnValue();
  const open = vi.fn();
  await showNotification(told("sinew-run-3", open), { notification: true, sound: false });
  expect(shown.map(({ title, options }) => [title, options.body, options.tag])).toEqual([
    ["Tracking, run 3: completed", "Steps", "sinew-run-3"],
  ]);
  expect(tones).toEqual([]);
  expect(open).not.toHaveBeenCalled();
  shown[0]?.onclick?.();
  expect(
    [focused, open, shown[0]?.close].map((one) => vi.mocked(one as () => void).mock.calls.length),
  ).toEqual([1, 1, 1]);
});

it("tells nothing to whoever looks", async () => {
  useBrowser("granted");
  look(true);
  await showNotification(told(), BOTH);
  expect([shown, tones]).toEqual([[], []]);
});

it("tells nothing while another tab is looked at, and again when that is not", async () => {
  useBrowser("granted");
  look(true);
  const end = announceVisibility(); // of the other tab
  vi.spyOn(document, "visibilityState", "get").mockReturnValue("hidden"); // what this one has
  await showNotification(told(), BOTH);
  expect(shown).toEqual([]);
  end();
  await vi.advanceTimersByTimeAsync(1);
  await showNotification(told(), BOTH);
  expect(shown).toHaveLength(1);
});

it("tells one thing once, however many tabs hear of it, and another one too", async () => {
  useBrowser("granted");
  await Promise.all([
    showNotification(told(), BOTH),
    showNotification(told(), BOTH),
    showNotification(told(), BOTH),
  ]);
  expect([shown.length, tones.length]).toEqual([1, 1]);
  await showNotification(told("sinew-run-4"), BOTH);
  expect(shown.map(({ options }) => options.tag)).toEqual(["sinew-run-3", "sinew-run-4"]);
});

it("has a sound without notifications, and neither where they are not allowed and it is off", async () => {
  useBrowser("denied");
  await showNotification(told("sinew-run-3"), BOTH);
  expect([shown.length, tones.length]).toEqual([0, 1]);
  await showNotification(told("sinew-run-4"), { notification: true, sound: false });
  expect([shown.length, tones.length]).toEqual([0, 1]);
});

/** Another tab of the same browser: with modules, and so audio, of its own. */
async function tab(): Promise<typeof showNotification> {
  vi.resetModules();
  return (await import("./notifications")).showNotification;
}

it("sounds in a tab that was clicked, though one that was not hears of it first", async () => {
  useBrowser("granted");
  const [first, second, third] = [await tab(), await tab(), await tab()];
  clicked.yet = false;
  const untouched = first(told(), BOTH);
  await vi.advanceTimersByTimeAsync(10);
  expect([shown.length, tones.length]).toEqual([1, 0]);
  clicked.yet = true;
  await Promise.all([second(told(), BOTH), third(told(), BOTH)]);
  expect([shown.length, tones.length]).toEqual([1, 1]);
  await vi.advanceTimersByTimeAsync(2000);
  await untouched;
  expect([shown.length, tones.length]).toEqual([1, 1]);
});

it("begins no tone where it cannot be heard, at a later click neither", async () => {
  useBrowser("denied");
  const only = await tab();
  clicked.yet = false;
  const telling = only(told(), BOTH);
  await vi.advanceTimersByTimeAsync(2000);
  await telling;
  clicked.yet = true;
  await vi.advanceTimersByTimeAsync(60_000);
  expect(tones).toEqual([]);
  await only(told("sinew-run-4"), BOTH);
  expect(tones).toHaveLength(1);
});
