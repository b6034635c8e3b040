/** The pages. */

import {
  IconActivityHeartbeat,
  IconAdjustmentsHorizontal,
  IconDatabase,
  IconFlask,
  IconListCheck,
  IconServerCog,
  IconWaveSine,
} from "@tabler/icons-react";
import { Link, useLocation } from "wouter";
import styles from "./Navigation.module.css";

export const PAGES = [
  { path: "/operate", name: "Operate", key: "o", Icon: IconActivityHeartbeat },
  { path: "/identify", name: "Identify", key: "i", Icon: IconWaveSine },
  { path: "/banks", name: "Banks", key: "b", Icon: IconAdjustmentsHorizontal },
  { path: "/experiments", name: "Experiments", key: "e", Icon: IconFlask },
  { path: "/runs", name: "Runs", key: "r", Icon: IconDatabase },
  { path: "/system", name: "System", key: "s", Icon: IconServerCog },
] as const;

export function Navigation({ onSetup }: { onSetup: () => void }) {
  const [location] = useLocation();
  return (
    <nav className={styles.nav} aria-label="Main">
      {PAGES.map(({ path, name, Icon }) => {
        const here = location === path || location.startsWith(`${path}/`);
        return (
          <Link key={path} href={path} className={styles.link} aria-current={here ? "page" : undefined}>
            <Icon size={22} stroke={1.6} aria-hidden="true" />
            {name}
          </Link>
        );
      })}
      <button
        type="button"
        className={`${styles.link} ${styles.setup}`}
        aria-label="Set-up"
        onClick={onSetup}
      >
        <IconListCheck size={22} stroke={1.6} aria-hidden="true" />
        Set-up
      </button>
    </nav>
  );
}
