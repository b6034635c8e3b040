/** Everything that explains: docs, glossary, tour, keys. */

import { Menu } from "@mantine/core";
import { TbBook2, TbHelp, TbKeyboard, TbMap2, TbVocabulary } from "react-icons/tb";
import { useLocation } from "wouter";
import { usePreferences } from "../service/preferences";
import styles from "./Navigation.module.css";

export function HelpMenu({ onShortcuts }: { onShortcuts: () => void }) {
  const [location, go] = useLocation();
  const { change } = usePreferences();
  const here = ["/docs", "/glossary"].some((path) => location.startsWith(path));
  return (
    <Menu position="right-end" width={210} withinPortal>
      <Menu.Target>
        <button type="button" className={styles.link} aria-label="Help" data-here={here}>
          <TbHelp size={22} strokeWidth={1.6} aria-hidden="true" />
          Help
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.Item leftSection={<TbBook2 size={16} />} onClick={() => go("/docs")}>
          Docs
        </Menu.Item>
        <Menu.Item leftSection={<TbVocabulary size={16} />} onClick={() => go("/glossary")}>
          Glossary
        </Menu.Item>
        <Menu.Item leftSection={<TbMap2 size={16} />} onClick={() => change({ toured: false })}>
          Tour
        </Menu.Item>
        <Menu.Item leftSection={<TbKeyboard size={16} />} onClick={onShortcuts}>
          Keyboard shortcuts
        </Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}
