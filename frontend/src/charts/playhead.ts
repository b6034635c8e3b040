/** Where a recording is looked at: set by the pointer on the charts, by a slider, or by playing. */

import { useSyncExternalStore } from "react";

export class Playhead {
  private running = false;
  private readonly listeners = new Set<() => void>();

  constructor(private at = 0) {}

  get at_s(): number {
    return this.at;
  }

  get playing(): boolean {
    return this.running;
  }

  readonly subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  };

  set(at_s: number): void {
    this.at = at_s;
    this.tell();
  }

  play(running: boolean): void {
    this.running = running;
    this.tell();
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}

export function usePlayhead(playhead: Playhead): { at_s: number; playing: boolean } {
  const at_s = useSyncExternalStore(playhead.subscribe, () => playhead.at_s);
  const playing = useSyncExternalStore(playhead.subscribe, () => playhead.playing);
  return { at_s, playing };
}
