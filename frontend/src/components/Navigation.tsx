/** The pages: those that there are for what is driven. */

import type { IconType } from "react-icons";
import {
  TbActivityHeartbeat,
  TbAdjustmentsHorizontal,
  TbDatabase,
  TbFlask,
  TbGridDots,
  TbListCheck,
  TbListDetails,
  TbPlugConnected,
  TbServerCog,
  TbWaveSine,
} from "react-icons/tb";
import { Link, useLocation } from "wouter";
import { useLive } from "../live/react";
import type { PlantView } from "../wire/types";
import { HelpMenu } from "./HelpMenu";
import styles from "./Navigation.module.css";

interface PageEntry {
  readonly path: string;
  readonly name: string;
  readonly key: string;
  readonly Icon: IconType;
  /** What is driven where there is something to do on it; on everything where left out. */
  readonly only?: readonly PlantView["kind"][];
}

const PAGES: readonly PageEntry[] = [
  { path: "/operate", name: "Operate", key: "o", Icon: TbActivityHeartbeat },
  { path: "/bring-up", name: "Bring-up", key: "u", Icon: TbPlugConnected, only: ["rig", "virtual_card"] },
  { path: "/identify", name: "Identify", key: "i", Icon: TbWaveSine },
  { path: "/banks", name: "Banks", key: "b", Icon: TbAdjustmentsHorizontal },
  { path: "/experiments", name: "Experiments", key: "e", Icon: TbFlask },
  { path: "/studies", name: "Studies", key: "t", Icon: TbGridDots },
  { path: "/runs", name: "Runs", key: "r", Icon: TbDatabase },
  { path: "/log", name: "Log", key: "h", Icon: TbListDetails },
  { path: "/system", name: "System", key: "s", Icon: TbServerCog },
];

/** The pages to be offered now. */
export function usePages(): readonly PageEntry[] {
  const kind = useLive((live) => live.state?.plant.kind);
  return PAGES.filter(({ only }) => only === undefined || (kind !== undefined && only.includes(kind)));
}

interface NavigationProps {
  onSetup(): void;
  onShortcuts(): void;
}

export function Navigation({ onSetup, onShortcuts }: NavigationProps) {
  const [location] = useLocation();
  const pages = usePages();
  return (
    <nav className={styles.nav} aria-label="Main">
      {pages.map(({ path, name, Icon }) => {
        const here = location === path || location.startsWith(`${path}/`);
        return (
          <Link key={path} href={path} className={styles.link} aria-current={here ? "page" : undefined}>
            <Icon size={22} strokeWidth={1.6} aria-hidden="true" />
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
        <TbListCheck size={22} strokeWidth={1.6} aria-hidden="true" />
        Set-up
      </button>
      <HelpMenu onShortcuts={onShortcuts} />
    </nav>
  );
}
