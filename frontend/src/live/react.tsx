/** The live store for React. */

import { createContext, type ReactNode, useContext, useEffect, useState, useSyncExternalStore } from "react";
import { liveUrl } from "../wire/address";
import { keepConnected } from "./socket";
import { type Live, LiveStore } from "./store";

const StoreContext = createContext<LiveStore | null>(null);

/** Holds the one connection of the page. */
export function LiveProvider({ children, store }: { children: ReactNode; store?: LiveStore }) {
  const [held] = useState(() => store ?? new LiveStore(performance.now()));
  useEffect(
    () => (store === undefined ? keepConnected(held, liveUrl(window.location.href)) : undefined),
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

/** Samples older than this are not shown as present ones [s]. */
const OLD_S = 0.3;
const LOOK_MS = 100;

/** How old the newest sample is [s], to a tenth, once it is older than `OLD_S`; null while it is fresh or there is none. */
export function useSampleAge(): number | null {
  const store = useLiveStore();
  const [old_s, setOld] = useState<number | null>(null);
  useEffect(() => {
    const look = () => {
      const age_s = store.age(performance.now() / 1000);
      setOld(age_s !== null && age_s > OLD_S ? Math.round(age_s * 10) / 10 : null);
    };
    look();
    const timer = window.setInterval(look, LOOK_MS);
    return () => window.clearInterval(timer);
  }, [store]);
  return old_s;
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
