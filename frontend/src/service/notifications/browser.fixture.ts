/** Simulated browser interfaces that tabs share: notifications, audio, visibility and locks. */

import { vi } from "vitest";

interface Shown {
  readonly title: string;
  readonly options: NotificationOptions;
  onclick: (() => void) | null;
  close(): void;
}

/** Every notification that was shown. */
export const shown: Shown[] = [];
/** Frequencies of the tones that were started. */
export const tones: number[] = [];
/** Whether pages were clicked since they were loaded: browsers play audio only afterwards. */
export const clicked = { yet: true };

export function useBrowser(permission: NotificationPermission, answer: NotificationPermission = permission) {
  const asked = vi.fn();
  class FakeNotification {
    static permission = permission;
    static async requestPermission(): Promise<NotificationPermission> {
      asked();
      FakeNotification.permission = answer;
      return answer;
    }
    onclick: (() => void) | null = null;
    readonly close = vi.fn();
    constructor(
      readonly title: string,
      readonly options: NotificationOptions,
    ) {
      shown.push(this);
    }
  }
  const node = { connect: () => node, gain: { setValueAtTime() {}, exponentialRampToValueAtTime() {} } };
  const tone = { ...node, frequency: { value: 0 }, start: () => tones.push(tone.frequency.value), stop() {} };
  class FakeAudio {
    readonly currentTime = 0;
    state = "suspended";
    resume(): Promise<void> {
      if (!clicked.yet) return new Promise(() => undefined);
      this.state = "running";
      return Promise.resolve();
    }
    readonly createOscillator = () => tone;
    readonly createGain = () => node;
  }
  vi.stubGlobal("isSecureContext", true);
  vi.stubGlobal("Notification", FakeNotification);
  vi.stubGlobal("AudioContext", FakeAudio);
  vi.stubGlobal("navigator", { ...navigator, locks: new FakeLocks() });
  shown.length = 0;
  tones.length = 0;
  clicked.yet = true;
  return { asked };
}

/** Sets whether this tab is visible. */
export function setVisibility(visible: boolean): void {
  vi.spyOn(document, "visibilityState", "get").mockReturnValue(visible ? "visible" : "hidden");
  document.dispatchEvent(new Event("visibilitychange"));
}

/** The browser's locks: a request with `ifAvailable` gets none while its name is locked. */
class FakeLocks {
  private readonly held: { name: string; mode: string }[] = [];

  async query() {
    return { held: [...this.held] };
  }

  async request(
    name: string,
    { mode = "exclusive", ifAvailable = false }: { mode?: string; ifAvailable?: boolean },
    work: (lock: object | null) => unknown,
  ): Promise<void> {
    if (ifAvailable && this.held.some((one) => one.name === name)) {
      await work(null);
      return;
    }
    const lock = { name, mode };
    this.held.push(lock);
    await work(lock);
    this.held.splice(this.held.indexOf(lock), 1);
  }
}
