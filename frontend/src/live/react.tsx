/** The live store for React. */

import { createContext, type ReactNode, useContext, useEffect, useState, useSyncExternalStore } from "react";
import { keepConnected, liveUrl } from "./socket";
import { type Live, LiveStore } from "./store";

const StoreContext = createContext<LiveStore | null>(null);

/** Holds the one connection of the page. */
export function LiveProvider({ children, store }: { children: ReactNode; store?: LiveStore }) {
  const [held] = useState(() => store ?? new LiveStore(performance.now()));
  useEffect(
    () => (store === undefined ? keepConnected(held, liveUrl(window.location)) : undefined),
    [held, store],
  );
  return <StoreContext value={held}>{children}</StoreContext>;
}

/** The store itself, for what draws on its own frames. */
export function useLiveStore(): LiveStore {
  const store = useContext(StoreContext);
  if (store === null) throw new Error("LiveProvider is missing above this component");
  return store;
}

/** A part of the slow state; the component renders when that part changes. */
export function useLive<Part>(select: (live: Live) => Part): Part {
  const store = useLiveStore();
  return useSyncExternalStore(store.subscribe, () => select(store.snapshot()));
}

/** Page time [ms], renewed every `every_ms`; for ages. */
export function useNow(every_ms: number): number {
  const [now, setNow] = useState(() => performance.now());
  useEffect(() => {
    const timer = window.setInterval(() => setNow(performance.now()), every_ms);
    return () => window.clearInterval(timer);
  }, [every_ms]);
  return now;
}
