/** A refusal for as long as its cause lasts. */

import { useState, useSyncExternalStore } from "react";
import { useLive } from "../live/react";
import { heldEpoch, watchHeld } from "../wire/control";
import { circumstances, NOTHING, stands } from "./standing";

/** `error` until what caused it is gone; `about` is what the request would have changed, as it is in force. */
export function useErrorLifetime(error: Error | null | undefined, about?: unknown): Error | null {
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const refused = error ?? null;
  const now = useLive((live) => (refused === null ? "" : circumstances(refused, live, epoch, about)));
  const [before, keep] = useState(NOTHING);
  const standing = stands(before, refused, now, performance.now());
  if (standing !== before) keep(standing);
  return standing.over ? null : refused;
}
