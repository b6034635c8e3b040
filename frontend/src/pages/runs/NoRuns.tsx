/** What there will be to look at, and what begins it. */

import { Link } from "wouter";
import page from "../Page.module.css";
import styles from "./Runs.module.css";

const WAYS = [
  {
    href: "/operate",
    title: "A session",
    told: "begins with the mode run and ends with it: every sample at 1 kHz, each command and each change of λ at its second.",
  },
  {
    href: "/identify",
    title: "An identification",
    told: "keeps excitation, samples and models, so that a bank made of it leads back to them.",
  },
  {
    href: "/experiments",
    title: "An experiment",
    told: "keeps its references, its criteria and a report that can be checked number by number.",
  },
] as const;

export function NoRuns() {
  return (
    <div className={styles.none}>
      <p className={page.empty}>Nothing recorded yet. A run begins with the mode run.</p>
      <ul className={styles.ways} aria-label="What is recorded">
        {WAYS.map(({ href, title, told }) => (
          <li key={href}>
            <Link href={href}>{title}</Link> {told}
          </li>
        ))}
      </ul>
      <p className={page.empty}>
        Any run can be replayed in charts and 3D, set beside others, and taken home as CSV, Parquet, MATLAB or
        MCAP.
      </p>
    </div>
  );
}
