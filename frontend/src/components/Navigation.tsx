/** Links to the pages, and the help menu. */

import { Menu } from "@mantine/core";
import type { IconType } from "react-icons";
import {
  TbActivityHeartbeat,
  TbAdjustmentsHorizontal,
  TbBook2,
  TbDatabase,
  TbFlask,
  TbGridDots,
  TbHelp,
  TbKeyboard,
  TbListCheck,
  TbListDetails,
  TbMap2,
  TbPlugConnected,
  TbServerCog,
  TbVocabulary,
  TbWaveSine,
} from "react-icons/tb";
import { Link, useLocation } from "wouter";
import { useLive } from "../live/react";
import { usePreferences } from "../service/api/preferences";
import type { PlantView } from "../wire/types";
import styles from "./Navigation.module.css";
import { TEXTS } from "./texts";

/** Help menu: documents, glossary, tour, keyboard shortcuts. */

function HelpMenu({ onShortcuts }: { onShortcuts: () => void }) {
  const [location, go] = useLocation();
  const { change } = usePreferences();
  const isCurrent = ["/docs", "/glossary"].some((path) => location.startsWith(path));
  return (
    <Menu position="right-end" width={210} withinPortal>
      <Menu.Target>
        <button type="button" className={styles.link} aria-label={TEXTS.help} data-here={isCurrent}>
          <TbHelp size={22} strokeWidth={1.6} aria-hidden="true" />
          {TEXTS.help}
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.Item leftSection={<TbBook2 size={16} />} onClick={() => go("/docs")}>
          {TEXTS.docs}
        </Menu.Item>
        <Menu.Item leftSection={<TbVocabulary size={16} />} onClick={() => go("/glossary")}>
          {TEXTS.glossary}
        </Menu.Item>
        <Menu.Item leftSection={<TbMap2 size={16} />} onClick={() => change({ toured: false })}>
          {TEXTS.tour}
        </Menu.Item>
        <Menu.Item leftSection={<TbKeyboard size={16} />} onClick={onShortcuts}>
          {TEXTS.shortcuts}
        </Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}

interface PageEntry {
  readonly path: string;
  readonly name: string;
  readonly key: string;
  readonly Icon: IconType;
  /** Kinds of plants for which the page exists; all if omitted. */
  readonly only?: readonly PlantView["kind"][];
}

const PAGES: readonly PageEntry[] = [
  { path: "/operate", name: TEXTS.operate, key: "o", Icon: TbActivityHeartbeat },
  { path: "/bring-up", name: TEXTS.bringUp, key: "u", Icon: TbPlugConnected, only: ["rig", "virtual_card"] },
  { path: "/identify", name: TEXTS.identify, key: "i", Icon: TbWaveSine },
  { path: "/banks", name: TEXTS.banks, key: "b", Icon: TbAdjustmentsHorizontal },
  { path: "/experiments", name: TEXTS.experiments, key: "e", Icon: TbFlask },
  { path: "/studies", name: TEXTS.studies, key: "t", Icon: TbGridDots },
  { path: "/runs", name: TEXTS.runs, key: "r", Icon: TbDatabase },
  { path: "/log", name: TEXTS.log, key: "h", Icon: TbListDetails },
  { path: "/system", name: TEXTS.systemPage, key: "s", Icon: TbServerCog },
];

/** Pages that exist for the current plant. */
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
    <nav className={styles.nav} aria-label={TEXTS.main}>
      {pages.map(({ path, name, Icon }) => {
        const isCurrent = location === path || location.startsWith(`${path}/`);
        return (
          <Link key={path} href={path} className={styles.link} aria-current={isCurrent ? "page" : undefined}>
            <Icon size={22} strokeWidth={1.6} aria-hidden="true" />
            {name}
          </Link>
        );
      })}
      <button
        type="button"
        className={`${styles.link} ${styles.setup}`}
        aria-label={TEXTS.setup}
        onClick={onSetup}
      >
        <TbListCheck size={22} strokeWidth={1.6} aria-hidden="true" />
        {TEXTS.setup}
      </button>
      <HelpMenu onShortcuts={onShortcuts} />
    </nav>
  );
}
