/** Parts of the sliders for references and tuning parameters: targets by key, and a lock for touch screens. */

import { type KeyboardEvent, type ReactNode, useEffect, useState } from "react";
import { TbLock } from "react-icons/tb";
import { fillText } from "../samples/texts";
import styles from "./TouchLock.module.css";
import { TEXTS } from "./texts";

/**
 * Keys that would move a slider to its end in one step: they show the target first, Enter sends it, Escape discards
 * it. While a target is shown, the arrow keys move it and send nothing.
 */

interface TargetKeysProps {
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly value: number;
  /** Whether the shown target has not been sent. */
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

/** Target after a key press; null if the key has no effect here. */
function targetOf(key: string, { min, max, step, value }: Scale, proposed: boolean): number | null {
  if (key === "Home") return min;
  if (key === "End") return max;
  if (!proposed) return null;
  if (key === "ArrowUp" || key === "ArrowRight") return Math.min(value + step, max);
  if (key === "ArrowDown" || key === "ArrowLeft") return Math.max(value - step, min);
  return null;
}

/** Lock of a slider on touch screens, so that scrolling does not move it: a tap unlocks it. */

/** Time without a touch after which the slider is locked again. */
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
