/** The view of one stack: React shows it, the drawing loop reads it without rendering. */

import { type RefObject, useCallback, useRef, useState } from "react";
import { LIVE, type Viewport } from "./viewport";

export interface ViewControl {
  readonly view: Viewport;
  readonly current: RefObject<Viewport>;
  change(to: Viewport): void;
}

export function useViewport(initial: Viewport = LIVE): ViewControl {
  const [view, setView] = useState(initial);
  const current = useRef(initial);
  const change = useCallback((to: Viewport) => {
    current.current = to;
    setView(to);
  }, []);
  return { view, current, change };
}
