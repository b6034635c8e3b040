/** Telling somebody who does not look at the page: the browser's notifications, and a sound; once for all open tabs. */

/** What the browser says of notifications of this page; "insecure" and "missing" where it has none. */
export type Allowed = NotificationPermission | "insecure" | "missing";

export interface Told {
  /** What happened, by its own name: the same in every tab. */
  readonly tag: string;
  readonly title: string;
  readonly body: string;
  /** Where whoever clicks is led. */
  open(): void;
}

export interface Ways {
  readonly notification: boolean;
  readonly sound: boolean;
}

const LOOKED_AT = "sinew-looked-at";
/** Tabs hear of the same thing within seconds of each other. */
const REMEMBERED_MS = 60_000;
const TONE_HZ = 880;
const TONE_S = 0.25;

export function allowed(): Allowed {
  if (!globalThis.isSecureContext) return "insecure";
  return "Notification" in globalThis ? Notification.permission : "missing";
}

/** Ask the person through the browser; only in answer to a click of theirs. */
export async function askForPermission(): Promise<Allowed> {
  const now = allowed();
  return now === "insecure" || now === "missing" ? now : await Notification.requestPermission();
}

/** Let other tabs know while this one is looked at; returns how to end that. */
export function keepLookedAt(): () => void {
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
export async function tell(told: Told, ways: Ways): Promise<void> {
  if (document.visibilityState === "visible") return;
  const { locks } = navigator;
  if (locks === undefined) {
    tellNow(told, ways); // tabs cannot agree: notifications of one tag are one all the same
    return;
  }
  const { held = [] } = await locks.query();
  if (held.some(({ name }) => name === LOOKED_AT)) return;
  await new Promise<void>((done) => {
    void locks.request(`sinew-told-${told.tag}`, { ifAvailable: true }, async (lock) => {
      if (lock !== null) tellNow(told, ways);
      done();
      if (lock !== null) await new Promise((over) => setTimeout(over, REMEMBERED_MS));
    });
  });
}

function tellNow({ tag, title, body, open }: Told, { notification, sound }: Ways): void {
  if (notification && allowed() === "granted") {
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
  if (sound) playTone();
}

let audio: AudioContext | null = null;

/** A short tone; a browser plays it only on a page that was clicked since it was loaded. */
export function playTone(): void {
  if (!("AudioContext" in globalThis)) return;
  audio ??= new AudioContext();
  void audio.resume();
  const now_s = audio.currentTime;
  const tone = audio.createOscillator();
  const loudness = audio.createGain();
  tone.frequency.value = TONE_HZ;
  loudness.gain.setValueAtTime(0.2, now_s);
  loudness.gain.exponentialRampToValueAtTime(0.001, now_s + TONE_S);
  tone.connect(loudness).connect(audio.destination);
  tone.start(now_s);
  tone.stop(now_s + TONE_S);
}
