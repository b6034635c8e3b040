import { TEXTS } from "../texts";

const WHY_NOT: Readonly<Record<NotificationAccess, string>> = {
  granted: "",
  default: TEXTS.notAllowedYet,
  denied: TEXTS.denied,
  insecure: TEXTS.insecure,
  missing: TEXTS.missing,
};

/** What keeps notifications from being shown here, and what to do; "" where nothing does. */
export function whyNotNotified(allowed: NotificationAccess): string {
  return WHY_NOT[allowed];
}

/** Telling somebody who does not look at the page: the browser's notifications, and a sound; once for all open tabs. */

/** What the browser says of notifications of this page; "insecure" and "missing" where it has none. */
export type NotificationAccess = NotificationPermission | "insecure" | "missing";

export interface PageNotification {
  /** What happened, by its own name: the same in every tab. */
  readonly tag: string;
  readonly title: string;
  readonly body: string;
  /** Where whoever clicks is led. */
  open(): void;
}

export interface Channels {
  readonly notification: boolean;
  readonly sound: boolean;
}

const LOOKED_AT = "sinew-looked-at";
/** Tabs hear of the same thing within seconds of each other. */
const REMEMBERED_MS = 60_000;
/** Audio that may play goes on within some tens of these [ms]. */
const RESUMED_WITHIN_MS = 1000;
const TONE_HZ = 880;
const TONE_S = 0.25;

export function notificationAccess(): NotificationAccess {
  if (!globalThis.isSecureContext) return "insecure";
  return "Notification" in globalThis ? Notification.permission : "missing";
}

/** Ask the person through the browser; only in answer to a click of theirs. */
export async function askForPermission(): Promise<NotificationAccess> {
  const now = notificationAccess();
  return now === "insecure" || now === "missing" ? now : await Notification.requestPermission();
}

/** Let other tabs know while this one is looked at; returns how to end that. */
export function announceVisibility(): () => void {
  let letGo: (() => void) | null = null;
  function follow(): void {
    if (document.visibilityState !== "visible") {
      letGo?.();
      letGo = null;
    } else if (letGo === null) {
      const until = new Promise<void>((resolve) => {
        letGo = resolve;
      });
      void navigator.locks?.request(LOOKED_AT, { mode: "shared" }, () => until);
    }
  }
  follow();
  document.addEventListener("visibilitychange", follow);
  return () => {
    document.removeEventListener("visibilitychange", follow);
    letGo?.();
    letGo = null;
  };
}

/** Tell it in these ways, unless a tab of this page is looked at, or another one has told it. */
export async function showNotification(told: PageNotification, ways: Channels): Promise<void> {
  if (await isAnyTabVisible()) return;
  await Promise.all([
    ways.notification &&
      notificationAccess() === "granted" &&
      once(`sinew-told-${told.tag}`, () => show(told)),
    ways.sound && soundOnce(told.tag),
  ]);
}

async function isAnyTabVisible(): Promise<boolean> {
  if (document.visibilityState === "visible") return true;
  const { held = [] } = (await navigator.locks?.query()) ?? {};
  return held.some(({ name }) => name === LOOKED_AT);
}

/** Do it in one of the tabs. Where they cannot agree all do: notifications of one tag are one all the same. */
async function once(name: string, act: () => void): Promise<void> {
  const { locks } = navigator;
  if (locks === undefined) {
    act();
    return;
  }
  await new Promise<void>((done) => {
    void locks.request(name, { ifAvailable: true }, async (lock) => {
      if (lock !== null) act();
      done();
      if (lock !== null) await new Promise((over) => setTimeout(over, REMEMBERED_MS));
    });
  });
}

/** A tab that cannot play leaves it to those that can. */
async function soundOnce(tag: string): Promise<void> {
  const ready = await playing();
  if (ready === null || (await isAnyTabVisible())) return;
  await once(`sinew-heard-${tag}`, () => sound(ready));
}

function show({ tag, title, body, open }: PageNotification): void {
  try {
    const shown = new Notification(title, { tag, body, icon: "./sinew.svg", silent: true });
    shown.onclick = () => {
      window.focus();
      shown.close();
      open();
    };
  } catch {
    // a browser that takes them from installed pages only: the sound is left
  }
}

let audio: AudioContext | null = null;

/** What plays; null on a page that was not clicked since it was loaded, on which a browser plays nothing. */
async function playing(): Promise<AudioContext | null> {
  if (!("AudioContext" in globalThis)) return null;
  audio ??= new AudioContext();
  const mine = audio;
  if (mine.state !== "running") {
    // without a click it is not refused: it waits for one
    const late = new Promise((over) => setTimeout(over, RESUMED_WITHIN_MS));
    await Promise.race([mine.resume().catch(() => undefined), late]);
  }
  return mine.state === "running" ? mine : null;
}

/** A short tone, at once or not at all. */
export async function playTone(): Promise<void> {
  const ready = await playing();
  if (ready !== null) sound(ready);
}

function sound(through: AudioContext): void {
  const now_s = through.currentTime;
  const tone = through.createOscillator();
  const loudness = through.createGain();
  tone.frequency.value = TONE_HZ;
  loudness.gain.setValueAtTime(0.2, now_s);
  loudness.gain.exponentialRampToValueAtTime(0.001, now_s + TONE_S);
  tone.connect(loudness).connect(through.destination);
  tone.start(now_s);
  tone.stop(now_s + TONE_S);
}
