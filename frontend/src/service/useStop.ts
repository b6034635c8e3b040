/** What became of the last press of STOP, which works without the application. */

import { useSyncExternalStore } from "react";
import { listenToStop, type StopState, stopState } from "../stop/stop";

export function useStop(): StopState {
  return useSyncExternalStore(listenToStop, stopState);
}
