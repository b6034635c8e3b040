/** React context and hooks of the live store. */

import { createContext, type ReactNode, useContext, useEffect, useState, useSyncExternalStore } from "react";
import { liveUrl } from "../wire/address";
import { connectStore } from "./socket";
import { type Live, LiveStore } from "./store";

const StoreContext = createContext<LiveStore | null>(null);

/** Provides the store and the page's only live connection. */
export function LiveProvider({ children, store }: { children: ReactNode; store?: LiveStore }) {
  const [used] = useState(() => store ?? new LiveStore(performance.now()));
  useEffect(
    () => (store === undefined ? connectStore(used, liveUrl(window.location.href)) : undefined),
    [used, store],
  );
  return <StoreContext value={used}>{children}</StoreContext>;
}

/** Returns the store itself, for components that draw on animation frames. */
export function useLiveStore(): LiveStore {
  const store = useContext(StoreContext);
  if (store === null) throw new Error("LiveProvider is missing above this component");
  return store;
}

/** Returns a part of the state; the component renders again when that part changes. */
export function useLive<Part>(select: (live: Live) => Part): Part {
  const store = useLiveStore();
  return useSyncExternalStore(store.subscribe, () => select(store.snapshot()));
}

/** Age above which samples are marked as old [s]. */
const OLD_S = 0.3;
const CHECK_MS = 100;

/** Age of the newest sample [s], to 0.1 s, once it exceeds `OLD_S`; otherwise null. */
export function useSampleAge(): number | null {
  const store = useLiveStore();
  const [old_s, setOld] = useState<number | null>(null);
  useEffect(() => {
    const check = () => {
      const age_s = store.age(performance.now() / 1000);
      setOld(age_s !== null && age_s > OLD_S ? Math.round(age_s * 10) / 10 : null);
    };
    check();
    const timer = window.setInterval(check, CHECK_MS);
    return () => window.clearInterval(timer);
  }, [store]);
  return old_s;
}

/** Page time [ms], updated every `every_ms`; used for ages. */
export function useNow(every_ms: number): number {
  const [now, setNow] = useState(() => performance.now());
  useEffect(() => {
    const timer = window.setInterval(() => setNow(performance.now()), every_ms);
    return () => window.clearInterval(timer);
  }, [every_ms]);
  return now;
}
