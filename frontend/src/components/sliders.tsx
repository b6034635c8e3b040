/** What a slider of a reference or a tuning parameter needs: targets by key, a lock against scrolling fingers. */

import { type KeyboardEvent, type ReactNode, useEffect, useState } from "react";
import { TbLock } from "react-icons/tb";
import { fillText } from "../samples/texts";
import styles from "./TouchLock.module.css";
import { TEXTS } from "./texts";

/**
 * Keys that would take a slider to its end in one step: they show the target first, Enter commands it, Escape leaves
 * it. While a target is shown the arrows move it; nothing is commanded by them then.
 */

interface TargetKeysProps {
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly value: number;
  /** Whether a target is shown that was not commanded. */
  readonly proposed: boolean;
  readonly children: ReactNode;
  onPropose(value: number): void;
  onCommand(): void;
  onLeave(): void;
}

export function TargetKeys(props: TargetKeysProps) {
  const { min, max, step, value, proposed, children, onPropose, onCommand, onLeave } = props;

  function press(event: KeyboardEvent): void {
    const target = targetOf(event.key, { min, max, step, value }, proposed);
    if (target !== null) onPropose(target);
    else if (proposed && event.key === "Enter") onCommand();
    else if (proposed && event.key === "Escape") onLeave();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  return (
    // biome-ignore lint/a11y/noStaticElementInteractions: the slider inside has the focus and the role
    <div
      style={{ display: "contents" }}
      onKeyDownCapture={press}
      onBlur={() => {
        if (proposed) onLeave();
      }}
    >
      {children}
    </div>
  );
}

interface Scale {
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly value: number;
}

/** Where a key would put the target; null where it is none of this slider's business. */
function targetOf(key: string, { min, max, step, value }: Scale, proposed: boolean): number | null {
  if (key === "Home") return min;
  if (key === "End") return max;
  if (!proposed) return null;
  if (key === "ArrowUp" || key === "ArrowRight") return Math.min(value + step, max);
  if (key === "ArrowDown" || key === "ArrowLeft") return Math.max(value - step, min);
  return null;
}

/** A slider that does not take hold of a finger that only scrolls by: on touch screens it is unlocked by a tap first. */

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
          aria-label={fillText(TEXTS.unlock, { name })}
          onClick={() => setTouched(performance.now())}
        >
          <TbLock size={14} aria-hidden="true" />
        </button>
      )}
    </div>
  );
}
