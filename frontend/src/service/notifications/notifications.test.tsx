import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { clicked, setVisibility, shown, tones, useBrowser } from "./browser.fixture";
import { announceVisibility, type PageNotification, showNotification } from "./notifications";

const BOTH = { notification: true, sound: true };

function notificationOf(tag = "sinew-run-3", open = () => undefined): PageNotification {
  return { tag, title: "Tracking, run 3: completed", body: "Steps", open };
}

beforeEach(() => {
  vi.useFakeTimers();
  setVisibility(false);
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
  vi.unstubAllGlobals();
});

it("shows a notification while the page is hidden, and opens its page on a click", async () => {
  useBrowser("granted");
  const focused = vi.spyOn(window, "focus").mockReturnValue();
  const open = vi.fn();
  await showNotification(notificationOf("sinew-run-3", open), { notification: true, sound: false });
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

it("shows no notification while the page is visible", async () => {
  useBrowser("granted");
  setVisibility(true);
  await showNotification(notificationOf(), BOTH);
  expect([shown, tones]).toEqual([[], []]);
});

it("shows no notification while another tab is visible", async () => {
  useBrowser("granted");
  setVisibility(true);
  const end = announceVisibility(); // the other tab
  vi.spyOn(document, "visibilityState", "get").mockReturnValue("hidden"); // this tab
  await showNotification(notificationOf(), BOTH);
  expect(shown).toEqual([]);
  end();
  await vi.advanceTimersByTimeAsync(1);
  await showNotification(notificationOf(), BOTH);
  expect(shown).toHaveLength(1);
});

it("shows each event once, for any number of tabs", async () => {
  useBrowser("granted");
  await Promise.all([
    showNotification(notificationOf(), BOTH),
    showNotification(notificationOf(), BOTH),
    showNotification(notificationOf(), BOTH),
  ]);
  expect([shown.length, tones.length]).toEqual([1, 1]);
  await showNotification(notificationOf("sinew-run-4"), BOTH);
  expect(shown.map(({ options }) => options.tag)).toEqual(["sinew-run-3", "sinew-run-4"]);
});

it("plays a sound if notifications are denied, and neither if the sound is off too", async () => {
  useBrowser("denied");
  await showNotification(notificationOf("sinew-run-3"), BOTH);
  expect([shown.length, tones.length]).toEqual([0, 1]);
  await showNotification(notificationOf("sinew-run-4"), { notification: true, sound: false });
  expect([shown.length, tones.length]).toEqual([0, 1]);
});

/** Another tab of the same browser, with its own modules and audio. */
async function tab(): Promise<typeof showNotification> {
  vi.resetModules();
  return (await import("./notifications")).showNotification;
}

it("plays the sound in a clicked tab, even if another tab detects the event first", async () => {
  useBrowser("granted");
  const [first, second, third] = [await tab(), await tab(), await tab()];
  clicked.yet = false;
  const untouched = first(notificationOf(), BOTH);
  await vi.advanceTimersByTimeAsync(10);
  expect([shown.length, tones.length]).toEqual([1, 0]);
  clicked.yet = true;
  await Promise.all([second(notificationOf(), BOTH), third(notificationOf(), BOTH)]);
  expect([shown.length, tones.length]).toEqual([1, 1]);
  await vi.advanceTimersByTimeAsync(2000);
  await untouched;
  expect([shown.length, tones.length]).toEqual([1, 1]);
});

it("plays no tone without a click, and none after a later click", async () => {
  useBrowser("denied");
  const only = await tab();
  clicked.yet = false;
  const pending = only(notificationOf(), BOTH);
  await vi.advanceTimersByTimeAsync(2000);
  await pending;
  clicked.yet = true;
  await vi.advanceTimersByTimeAsync(60_000);
  expect(tones).toEqual([]);
  await only(notificationOf("sinew-run-4"), BOTH);
  expect(tones).toHaveLength(1);
});
