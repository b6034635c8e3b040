/** A slider that does not take hold of a finger that only scrolls by: on touch screens it is unlocked by a tap first. */

import { type ReactNode, useEffect, useState } from "react";
import { TbLock } from "react-icons/tb";
import styles from "./TouchLock.module.css";

/** Locked again after so long without a touch. */
const LOCKED_AFTER_MS = 8000;

export function TouchLock({ name, children }: { name: string; children: ReactNode }) {
  const [touch] = useState(() => window.matchMedia("(pointer: coarse)").matches);
  const [touched, setTouched] = useState<number | null>(null);

  useEffect(() => {
    if (touched === null) return;
    const timer = window.setTimeout(() => setTouched(null), LOCKED_AFTER_MS);
    return () => window.clearTimeout(timer);
  }, [touched]);

  if (!touch) return children;
  return (
    <div className={styles.frame} onPointerDown={() => touched !== null && setTouched(performance.now())}>
      {children}
      {touched === null && (
        <button
          type="button"
          className={styles.lock}
          aria-label={`Unlock ${name}`}
          onClick={() => setTouched(performance.now())}
        >
          <TbLock size={14} aria-hidden="true" />
        </button>
      )}
    </div>
  );
}
