/** One press to each card of the controls, however far down it is. */

import { useRef } from "react";
import { useLive } from "../../live/react";
import styles from "./Operate.module.css";

/** Titles that are too long for the bar. */
const SHORT: Readonly<Record<string, string>> = { "Trigger capture": "Trigger" };

export function CardJumps() {
  const bar = useRef<HTMLElement>(null);
  const pushes = useLive((live) => (live.state?.limits.F_push_max ?? 0) > 0);
  const walls = useLive((live) => live.state?.plant.simulated ?? false);
  const known = useLive((live) => live.state !== null);
  const titles = [
    "Mode",
    "References",
    "Tuning",
    ...(known ? ["Touch"] : []),
    ...(pushes ? ["Push"] : []),
    ...(walls ? ["Wall"] : []),
    "Trigger capture",
  ];

  function jump(title: string): void {
    const card = bar.current?.parentElement?.querySelector<HTMLElement>(`section[aria-label="${title}"]`);
    if (!card) return;
    card.tabIndex = -1;
    card.focus({ preventScroll: true });
    card.scrollIntoView({ block: "start" });
  }

  return (
    <nav ref={bar} className={styles.jumps} aria-label="Controls">
      {titles.map((title) => (
        <button key={title} type="button" aria-label={`Go to ${title}`} onClick={() => jump(title)}>
          {SHORT[title] ?? title}
        </button>
      ))}
    </nav>
  );
}
