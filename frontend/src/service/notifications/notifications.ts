import { TEXTS } from "../texts";

const WHY_NOT: Readonly<Record<NotificationAccess, string>> = {
  granted: "",
  default: TEXTS.notAllowedYet,
  denied: TEXTS.denied,
  insecure: TEXTS.insecure,
  missing: TEXTS.missing,
};

/** Returns why the browser cannot show notifications, and the remedy; "" if it can. */
export function whyNotNotified(allowed: NotificationAccess): string {
  return WHY_NOT[allowed];
}

/** Permission for notifications; "insecure" and "missing" if the browser offers none here. */
export type NotificationAccess = NotificationPermission | "insecure" | "missing";

export interface PageNotification {
  /** Name of the event, the same in every tab. */
  readonly tag: string;
  readonly title: string;
  readonly body: string;
  /** Opens the page of the event, on a click. */
  open(): void;
}

export interface Channels {
  readonly notification: boolean;
  readonly sound: boolean;
}

const VISIBLE_LOCK = "sinew-visible";
/** Time for which a tab locks an event [ms]: tabs detect the same event within seconds of each other. */
const REMEMBERED_MS = 60_000;
/** Longest wait for audio to resume [ms]; permitted audio resumes within some tens of milliseconds. */
const RESUMED_WITHIN_MS = 1000;
const TONE_HZ = 880;
const TONE_S = 0.25;

export function notificationAccess(): NotificationAccess {
  if (!globalThis.isSecureContext) return "insecure";
  return "Notification" in globalThis ? Notification.permission : "missing";
}

/** Asks the person for permission; browsers permit this only in response to a click. */
export async function askForPermission(): Promise<NotificationAccess> {
  const now = notificationAccess();
  return now === "insecure" || now === "missing" ? now : await Notification.requestPermission();
}

/** Announces the visibility of this tab to other tabs, by a shared lock; returns a function that stops this. */
export function announceVisibility(): () => void {
  let release: (() => void) | null = null;
  function onVisibility(): void {
    if (document.visibilityState !== "visible") {
      release?.();
      release = null;
    } else if (release === null) {
      const until = new Promise<void>((resolve) => {
        release = resolve;
      });
      void navigator.locks?.request(VISIBLE_LOCK, { mode: "shared" }, () => until);
    }
  }
  onVisibility();
  document.addEventListener("visibilitychange", onVisibility);
  return () => {
    document.removeEventListener("visibilitychange", onVisibility);
    release?.();
    release = null;
  };
}

/** Shows a notification through these channels, unless a tab is visible or another tab has shown it. */
export async function showNotification(notification: PageNotification, channels: Channels): Promise<void> {
  if (await isAnyTabVisible()) return;
  await Promise.all([
    channels.notification &&
      notificationAccess() === "granted" &&
      once(`sinew-notified-${notification.tag}`, () => show(notification)),
    channels.sound && soundOnce(notification.tag),
  ]);
}

async function isAnyTabVisible(): Promise<boolean> {
  if (document.visibilityState === "visible") return true;
  const { held = [] } = (await navigator.locks?.query()) ?? {};
  return held.some(({ name }) => name === VISIBLE_LOCK);
}

/** Acts in one of the tabs. Without locks all tabs act, and the browser merges notifications of the same tag. */
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

/** Plays the sound in one tab, among those that can play audio. */
async function soundOnce(tag: string): Promise<void> {
  const ready = await runningAudio();
  if (ready === null || (await isAnyTabVisible())) return;
  await once(`sinew-sounded-${tag}`, () => sound(ready));
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
    // some browsers accept notifications from installed pages only: the sound remains
  }
}

let audio: AudioContext | null = null;

/** Returns running audio; null if the page was not clicked since it was loaded: browsers play nothing then. */
async function runningAudio(): Promise<AudioContext | null> {
  if (!("AudioContext" in globalThis)) return null;
  audio ??= new AudioContext();
  const mine = audio;
  if (mine.state !== "running") {
    // without a click, `resume` is not refused: it waits for one
    const late = new Promise((over) => setTimeout(over, RESUMED_WITHIN_MS));
    await Promise.race([mine.resume().catch(() => undefined), late]);
  }
  return mine.state === "running" ? mine : null;
}

/** Plays a short tone at once, if audio is available. */
export async function playTone(): Promise<void> {
  const ready = await runningAudio();
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
