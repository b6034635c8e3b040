/** Switches for what tells the person something while they do not look at the page. */

import { ActionIcon, Menu } from "@mantine/core";
import { useState } from "react";
import { TbBell, TbBellOff } from "react-icons/tb";
import { allowed, askForPermission, playTone } from "../service/notifications";
import { usePreferences } from "../service/preferences";
import { whyNotTold } from "../service/toldWords";
import styles from "./NotificationMenu.module.css";

const WHEN =
  "While no tab of this page is in sight: when an experiment or an identification is over, and when the joint trips.";

export function NotificationMenu() {
  const { preferences, change } = usePreferences();
  const [answer, setAnswer] = useState(allowed);
  const [asked, setAsked] = useState(false);
  const on = preferences.notify && answer === "granted";
  const Icon = on || preferences.sound ? TbBell : TbBellOff;

  async function toggle(): Promise<void> {
    if (on) {
      change({ notify: false });
      return;
    }
    const said = await askForPermission();
    setAnswer(said);
    setAsked(true);
    if (said === "granted") change({ notify: true });
  }

  function toggleSound(): void {
    if (!preferences.sound) void playTone();
    change({ sound: !preferences.sound });
  }

  const refused = answer === "default" && !preferences.notify && !asked ? "" : whyNotTold(answer);
  return (
    <Menu
      position="bottom-end"
      width={300}
      closeOnItemClick={false}
      withInitialFocusPlaceholder={false}
      onOpen={() => setAnswer(allowed())}
    >
      <Menu.Target>
        <ActionIcon
          variant="subtle"
          color="gray"
          aria-label="Notifications"
          title={`Notifications ${on ? "on" : "off"}, sound ${preferences.sound ? "on" : "off"}`}
        >
          <Icon size={18} />
        </ActionIcon>
      </Menu.Target>
      <Menu.Dropdown>
        <Menu.CheckboxItem checked={on} onChange={() => void toggle()}>
          Notifications
        </Menu.CheckboxItem>
        <Menu.CheckboxItem checked={preferences.sound} onChange={toggleSound}>
          Sound
        </Menu.CheckboxItem>
        <p className={styles.told}>{WHEN}</p>
        {refused !== "" && (
          <output aria-label="Notifications here" className={styles.told}>
            {refused}
          </output>
        )}
      </Menu.Dropdown>
    </Menu>
  );
}
