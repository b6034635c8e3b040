/** One STOP for the whole page: the button, and the keys from anywhere, text fields and the 3D view included. */

import {
  createContext,
  type ReactNode,
  useCallback,
  useContext,
  useEffect,
  useMemo,
  useRef,
  useState,
} from "react";
import { answered, api } from "../wire/client";
import type { State } from "../wire/types";
import { isStopKey, type StopState, sendStop, settled } from "./stop";

const ANSWER_WITHIN_MS = 1500;

interface Stopper {
  readonly state: StopState;
  stop(): void;
  /** The service has told its state: what it says of the stop counts from here on. */
  heard(state: State): void;
  /** Listen for the keys in another document of this page. */
  watch(target: Window): () => void;
}

const StopContext = createContext<Stopper | null>(null);

export function StopProvider({ children }: { children: ReactNode }) {
  const [state, setState] = useState<StopState>({ kind: "idle" });
  const latest = useRef(0);

  const stop = useCallback(() => {
    latest.current += 1;
    const number = latest.current;
    setState({ kind: "sending" });
    const post = () => answered(api.POST("/api/stop", { signal: AbortSignal.timeout(ANSWER_WITHIN_MS) }));
    void sendStop(post).then((result) => {
      if (number === latest.current) setState(result);
    });
  }, []);

  const heard = useCallback((told: State) => setState((stopped) => settled(stopped, told)), []);

  const watch = useCallback(
    (target: Window) => {
      const onKey = (event: KeyboardEvent) => {
        if (!isStopKey(event)) return;
        event.preventDefault();
        event.stopPropagation();
        if (!event.repeat) stop();
      };
      target.addEventListener("keydown", onKey, { capture: true });
      return () => target.removeEventListener("keydown", onKey, { capture: true });
    },
    [stop],
  );

  useEffect(() => watch(window), [watch]);
  const stopper = useMemo(() => ({ state, stop, heard, watch }), [state, stop, heard, watch]);
  return <StopContext value={stopper}>{children}</StopContext>;
}

export function useStop(): Stopper {
  const stopper = useContext(StopContext);
  if (stopper === null) throw new Error("StopProvider is missing above this component");
  return stopper;
}
